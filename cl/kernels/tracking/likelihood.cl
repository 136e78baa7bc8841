// How badly the poses of particles fit the voxels; twin: reference/likelihood/voxel.py.
// Defines: those of kinematics.h; VIEWS, the cameras whose outlines are in local memory at once, at
// most GROUP; NO_DISTORTION if no camera has any; TRUNK, the cone that hides limbs behind it, or -1.
// None depends on a body's size: bodies that differ in that alone share a program.
#if !defined(CAMERA_FLOATS) || !defined(N_CODES) || !defined(OUTLINE_FLOATS) || !defined(PACK) || \
    !defined(RATIO_STEPS) || !defined(TRUNK) || !defined(VIEWS)
#error "tracking/likelihood.cl needs CAMERA_FLOATS, N_CODES, OUTLINE_FLOATS, PACK, RATIO_STEPS, TRUNK and VIEWS"
#endif
#include "common/packed_cones.h"

// Slope from which a line counts as upright: that of half of a right angle's quarter, 67.5 degrees.
#define STEEP 2.41421356f

// Items that look at one camera's map.
#define VIEW_LANES (GROUP / VIEWS)

// Every (count / n_points)-th surface voxel's centre, so that their number is the same in every
// frame; points.w is 0 when there is no voxel at all.
__kernel void sample_surface(int n_points, __global const int *count,
                             __global const int *surface, int ny, int nz, float4 origin_size,
                             __global float4 *points)
{
    const int k = get_global_id(0);
    if (k >= n_points) return;
    if (count[0] == 0) {
        points[k] = (float4)(0.0f);
        return;
    }
    const int index = surface[(int)((long)k * count[0] / n_points)];
    const float3 ijk = (float3)(index / (ny * nz), index / nz % ny, index % nz);
    points[k] = (float4)(origin_size.xyz + (ijk + 0.5f) * origin_size.w, 1.0f);
}

// Sums over samples of a map: 255 - value, and how many of them lie in the picture; of `colour` the
// log ratios of visible samples, see part_colour.cl; of `contour` what visible samples of outlines
// find of contour.cl's.
typedef struct {
    vint edge, n_edge, inside, n_inside, colour, n_colour, contour, n_contour;
} samples;

// What is looked up in the pictures themselves: their codes, the tables of log ratios and where that
// of each particle's run begins, the part of every row, their contours along each normal, the pixels
// of a picture, and what the means of both weigh.
typedef struct {
    __global const uchar *codes;
    __global const char *ratios;
    vint table;
    __global const int *row_parts;
    __global const uchar *contours;
    int n_pixels;
    float colour_weight, contour_weight;
} picture_cues;

// Adds the sample at pixel (x, y), whose half is added already, of one channel of a map.
inline void take_sample(__global const float *camera, __global const uchar *channel, int width,
                        vfloat x, vfloat y, vint *error, vint *count)
{
    const vint inside = (x >= 0.0f) & (y >= 0.0f) & (x < camera[23]) & (y < camera[24]);
    const vint pixel = inside ? 2 * (TO_INT(y) * width + TO_INT(x)) : 0;
#define PIXEL(l) channel[LANE_OF(pixel, l)]
    const vint value = PACK_OF(vint, PIXEL);
#undef PIXEL
    *error += inside ? 255 - value : 0;
    *count += inside & 1;
}

// Whether a row of a cone, `row` as in take_row, lies further from the camera than the trunk's
// middle: what it shows inside the trunk's outline is hidden.
inline vint behind_trunk(__global const float *camera, __local const vfloat *cones, float4 row)
{
#if TRUNK < 0
    return (vint)0;
#else
    __local const vfloat *own = cones + (int)row.x * CONE_FLOATS;
    __local const vfloat *trunk = cones + TRUNK * CONE_FLOATS;
    vfloat further = 0.0f;
    for (int i = 0; i < 3; ++i)
        further += camera[6 + i] * (own[i] + row.y * (own[4 + i] - own[i]) -
                                    0.5f * (trunk[i] + trunk[4 + i]));
    return further > 0.0f;
#endif
}

// Whether pixel (x, y) lies in the trapezoid with these corners; never in one that is NOWHERE.
inline vint in_outline(__local const vfloat *corners, vfloat x, vfloat y)
{
    vint left = corners[0] > NOWHERE, right = left;
    for (int i = 0; i < 4; ++i) {
        const int j = (i + 1) % 4;
        const vfloat side = (corners[2 * j] - corners[2 * i]) * (y - corners[2 * i + 1]) -
                            (corners[2 * j + 1] - corners[2 * i + 1]) * (x - corners[2 * i]);
        left &= side >= 0.0f;
        right &= side <= 0.0f;
    }
    return left | right;
}

// Adds the log ratio of the colour at pixel (x, y), whose half is added already; table: where the
// part's ratios begin.
inline void take_colour(__global const float *camera, __global const uchar *codes,
                        __global const char *ratios, vint table, int width, vfloat x, vfloat y,
                        vint visible, samples *sums)
{
    const vint inside =
        visible & (x >= 0.0f) & (y >= 0.0f) & (x < camera[23]) & (y < camera[24]);
    const vint pixel = inside ? TO_INT(y) * width + TO_INT(x) : 0;
#define RATIO(l) ratios[LANE_OF(table, l) + codes[LANE_OF(pixel, l)]]
    const vint value = PACK_OF(vint, RATIO);
#undef RATIO
    sums->colour += inside ? value : 0;
    sums->n_colour += inside & 1;
}

// The normal, of contour.cl's four, of a line in direction (x, y).
inline vint normal_of(vfloat x, vfloat y)
{
    const vfloat across = most(x, -x), down = most(y, -y);
    const vint diagonal = x * y < 0.0f ? (vint)1 : (vint)3;
    return down > STEEP * across ? (vint)0 : across > STEEP * down ? (vint)2 : diagonal;
}

// Adds what the sample at pixel (x, y), whose half is added already, of an outline with this normal
// finds of contours.
inline void take_contour(__global const float *camera, picture_cues cues, vint normal, int width,
                         vfloat x, vfloat y, vint visible, samples *sums)
{
    const vint inside =
        visible & (x >= 0.0f) & (y >= 0.0f) & (x < camera[23]) & (y < camera[24]);
    const vint pixel = inside ? normal * cues.n_pixels + TO_INT(y) * width + TO_INT(x) : 0;
#define FOUND(l) cues.contours[LANE_OF(pixel, l)]
    const vint value = PACK_OF(vint, FOUND);
#undef FOUND
    sums->contour += inside ? value : 0;
    sums->n_contour += inside & 1;
}

// Whether a sample at pixel (x, y), whose half is added already, is seen: unless the row is `hidden`
// where the trunk's outline covers it.
inline vint seen_sample(__local const vfloat *outlines, vfloat x, vfloat y, vint hidden)
{
#if TRUNK < 0
    return (vint)-1;
#else
    return (hidden & in_outline(outlines + TRUNK * OUTLINE_FLOATS, x - 0.5f, y - 0.5f)) == 0;
#endif
}

// One row of a cone, x = its number, y = share of the way along it: samples at both outlines and z
// evenly between them, w = 1 / z.
// Where its part is looked for in the pictures, `part` is not negative and `hidden` says whether it
// lies behind the trunk. cues: of this camera.
inline void take_row(__global const float *camera, __global const uchar *map, int width,
                     __local const vfloat *outlines, float4 row, int part,
                     picture_cues cues, vint hidden, samples *sums)
{
    __local const vfloat *corner = outlines + (int)row.x * OUTLINE_FLOATS;
    const vfloat left_x = corner[0] + row.y * (corner[6] - corner[0]) + 0.5f;
    const vfloat left_y = corner[1] + row.y * (corner[7] - corner[1]) + 0.5f;
    const vfloat right_x = corner[2] + row.y * (corner[4] - corner[2]) + 0.5f;
    const vfloat right_y = corner[3] + row.y * (corner[5] - corner[3]) + 0.5f;
    take_sample(camera, map + 1, width, left_x, left_y, &sums->edge, &sums->n_edge);
    take_sample(camera, map + 1, width, right_x, right_y, &sums->edge, &sums->n_edge);
    if (part >= 0 && cues.contour_weight > 0.0f) {
        const vint left = normal_of(corner[6] - corner[0], corner[7] - corner[1]);
        const vint right = normal_of(corner[4] - corner[2], corner[5] - corner[3]);
        take_contour(camera, cues, left, width, left_x, left_y,
                     seen_sample(outlines, left_x, left_y, hidden), sums);
        take_contour(camera, cues, right, width, right_x, right_y,
                     seen_sample(outlines, right_x, right_y, hidden), sums);
    }
    const bool coloured = part >= 0 && cues.colour_weight > 0.0f;
    const vfloat step_x = (right_x - left_x) * row.w, step_y = (right_y - left_y) * row.w;
    const int n = (int)row.z;
    for (int column = 0; column < n; ++column) {
        const vfloat x = left_x + (column + 0.5f) * step_x;
        const vfloat y = left_y + (column + 0.5f) * step_y;
        take_sample(camera, map, width, x, y, &sums->inside, &sums->n_inside);
        if (coloured)
            take_colour(camera, cues.codes, cues.ratios, cues.table + part * N_CODES,
                        width, x, y, seen_sample(outlines, x, y, hidden), sums);
    }
}

// Song et al. eq. (14)-(15) of the cameras from `first_view` on, at most VIEWS of them: the items'
// sums over the rows of all cones become error and 1 of every camera that sees both edge and
// silhouette, else 0 and 0; the first item gets their sums. The error has, times their weights, what
// the contours that the camera sees along outlines lack of 1 on average, less the mean log ratio of
// the colours that it sees, as a share of its bound.
inline void score_views(int first_view, int n_views, int width, int height,
                        __global const float *cameras, __global const uchar *maps,
                        int n_rows, __local const float4 *rows, float2 weights,
                        picture_cues cues, __local const vfloat *cones, __local vfloat *outlines,
                        __local samples *partial, __local vfloat *views, vfloat *error,
                        vfloat *seeing)
{
    const int lane = get_local_id(0), here = min(VIEWS, n_views - first_view);
    for (int item = lane; item < here * N_CONES; item += GROUP)
        cone_outline(cones + item % N_CONES * CONE_FLOATS,
                     cameras + (first_view + item / N_CONES) * CAMERA_FLOATS,
                     outlines + item * OUTLINE_FLOATS);
    barrier(CLK_LOCAL_MEM_FENCE);

    const int view = lane / VIEW_LANES, view_lane = lane % VIEW_LANES;
    samples sums = {0, 0, 0, 0, 0, 0, 0, 0};
    if (view < here) {
        const size_t before = (size_t)(first_view + view) * cues.n_pixels;
        cues.codes += before;
        cues.contours += 4 * before;
        __global const float *camera = cameras + (first_view + view) * CAMERA_FLOATS;
        for (int r = view_lane; r < n_rows; r += VIEW_LANES) {
            const int part =
                cues.colour_weight > 0.0f || cues.contour_weight > 0.0f ? cues.row_parts[r] : -1;
            const vint hidden = part < 0 ? (vint)0 : behind_trunk(camera, cones, rows[r]);
            take_row(camera, maps + 2 * before, width,
                     outlines + view * N_CONES * OUTLINE_FLOATS, rows[r], part, cues, hidden,
                     &sums);
        }
    }
    partial[lane] = sums;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int size = VIEW_LANES; size > 1; size = (size + 1) / 2) {
        const int other = view_lane + (size + 1) / 2;
        if (view < VIEWS && other < size) {
            const samples more = partial[lane + (size + 1) / 2];
            partial[lane].edge += more.edge;
            partial[lane].n_edge += more.n_edge;
            partial[lane].inside += more.inside;
            partial[lane].n_inside += more.n_inside;
            partial[lane].colour += more.colour;
            partial[lane].n_colour += more.n_colour;
            partial[lane].contour += more.contour;
            partial[lane].n_contour += more.n_contour;
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (view_lane == 0 && view < here) {
        sums = partial[lane];
        const vint seen = (sums.n_edge > 0) & (sums.n_inside > 0);
        const vfloat edge = TO_FLOAT(sums.edge) / (255.0f * TO_FLOAT(sums.n_edge));
        const vfloat inside = TO_FLOAT(sums.inside) / (255.0f * TO_FLOAT(sums.n_inside));
        const vfloat known = most(TO_FLOAT(sums.n_colour), 1.0f);
        const vfloat colour = TO_FLOAT(sums.colour) / (RATIO_STEPS * known);
        const vfloat outlined = most(TO_FLOAT(sums.n_contour), 1.0f);
        const vfloat contour = 1.0f - TO_FLOAT(sums.contour) / (255.0f * outlined);
        const vfloat own = weights.x * edge + weights.y * inside - cues.colour_weight * colour +
                           cues.contour_weight * contour;
        views[2 * view] = seen ? own : 0.0f;
        views[2 * view + 1] = seen ? (vfloat)1.0f : 0.0f;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (lane == 0)
        for (int v = 0; v < here; ++v) {
            *error += views[2 * v];
            *seeing += views[2 * v + 1];
        }
}

// Sum over this item's share of `n` surface voxels, every `stride`-th from `first` on, after the
// last the first again, of d^2 / (d^2 + scale^2), d the distance to the nearest cone's surface
// (Geman & McClure 1987).
inline vfloat unexplained(int n_points, int first, int stride, int n, float scale,
                          __global const float4 *points, __local const vfloat *cones,
                          __local const vfloat *spans)
{
    vfloat sum = 0.0f;
    for (int k = get_local_id(0); k < n; k += GROUP) {
        const int at = first + k * stride;
        const float4 point = points[at < n_points ? at : at - n_points];
        const vpoint here = {point.x, point.y, point.z};
        vfloat nearest = 1e6f;
        for (int c = 0; c < N_CONES; ++c) {
            const vfloat d =
                packed_distance(cones + c * CONE_FLOATS, spans + c * SPAN_FLOATS, here);
            nearest = least(nearest, most(d, -d));
        }
        const vfloat ratio = nearest * (1.0f / scale);
        sum += point.w > 0.0f ? ratio * ratio / (1.0f + ratio * ratio) : (vfloat)1.0f;
    }
    return sum;
}

// Sum over this item's share of `pairs` (first, second cone) and three points of the first's axis
// of (overlap / radius)^2, at most 1 each: how deep parts that must not meet lie in each other.
inline vfloat overlap(int n_pairs, __global const int2 *pairs, __local const vfloat *cones,
                      __local const vfloat *spans)
{
    vfloat sum = 0.0f;
    for (int item = get_local_id(0); item < 3 * n_pairs; item += GROUP) {
        const int2 pair = pairs[item / 3];
        const float t = 0.5f * (item % 3);
        __local const vfloat *first = cones + pair.x * CONE_FLOATS;
        const vpoint point = {first[0] + t * (first[4] - first[0]),
                              first[1] + t * (first[5] - first[1]),
                              first[2] + t * (first[6] - first[2])};
        const vfloat radius = first[3] + t * (first[7] - first[3]);
        const vfloat distance = packed_distance(cones + pair.y * CONE_FLOATS,
                                                spans + pair.y * SPAN_FLOATS, point);
        const vfloat depth = within(1.0f - distance / radius, 0.0f, 1.0f);
        sum += depth * depth;
    }
    return sum;
}

// Sum over this item's share of the degrees of freedom of the squared distance from rest, in the
// posture's sigmas: posture has (rest, 1 / sigma), the latter 0 where all values are as likely.
inline vfloat posture_error(__global const float2 *posture, __global const float *poses, int first,
                     int n_particles)
{
    vfloat sum = 0.0f;
    for (int dof = get_local_id(0); dof < N_DOF; dof += GROUP) {
#define VALUE(l) poses[lane_index(first, 0x##l, n_particles) * N_DOF + dof]
        const vfloat bent = posture[dof].y * (PACK_OF(vfloat, VALUE) - posture[dof].x);
#undef VALUE
        sum += bent * bent;
    }
    return sum;
}

// The exponent of Song et al. eq. (16) with its sign put right: the sum over cameras of edge and
// silhouette error, to which surface, overlap and posture error are added once per camera. Cameras
// that see no sample are replaced by the mean of the others; if no camera sees any, by the worst.
// row_table: the n_rows rows of samples on all cones, for which `rows` is room.
// weights: of edge, silhouette, surface, overlap. n_per_run: particles of a run, whose table of
// table_size ratios they are compared with. row_parts: of every row, the part that is looked for in
// the pictures' codes and contours, or -1. One work-group per pack of particles.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void score_poses(int n_particles, __global const float *poses, __global const float *table,
                 int n_views, int width, int height, __global const float *cameras,
                 __global const uchar *maps, int n_rows, __global const float4 *row_table,
                 __local float4 *rows,
                 int n_points, int first_point, int stride, float scale,
                 __global const float4 *points, int n_pairs, __global const int2 *pairs,
                 __global const float2 *posture, float4 weights, float posture_weight,
                 __global const uchar *codes, __global const char *ratios, int n_per_run,
                 int table_size, __global const int *row_parts, float colour_weight,
                 __global const uchar *contours, float contour_weight, __global float *errors)
{
    __local vfloat turns[2 * N_DOF], frames[N_BONES * FRAME_FLOATS];
    __local vfloat cones[N_CONES * CONE_FLOATS] __attribute__((aligned(64)));
    __local vfloat spans[N_CONES * SPAN_FLOATS] __attribute__((aligned(64)));
    __local float body[BODY_FLOATS];
    __local vfloat outlines[VIEWS * N_CONES * OUTLINE_FLOATS], views[2 * VIEWS], sums[GROUP];
    __local samples partial[GROUP];
    const int lane = get_local_id(0), first = get_group_id(0) * PACK;
    for (int r = lane; r < n_rows; r += GROUP) rows[r] = row_table[r];
    take_cones(table, poses, first, n_particles, body, turns, frames, cones, spans);

#define TABLE(l) (lane_index(first, 0x##l, n_particles) / n_per_run * table_size)
    const picture_cues cues = {codes,    ratios,         PACK_OF(vint, TABLE), row_parts,
                               contours, width * height, colour_weight,        contour_weight};
#undef TABLE
    vfloat error = 0.0f, seeing = 0.0f;
    for (int view = 0; view < n_views; view += VIEWS)
        score_views(view, n_views, width, height, cameras, maps, n_rows, rows, weights.xy, cues, cones,
                    outlines, partial, views, &error, &seeing);

    const int n = (n_points + stride - 1) / stride;
    vfloat sum = 0.0f;
    if (weights.z > 0.0f)
        sum += weights.z / n *
               unexplained(n_points, first_point, stride, n, scale, points, cones, spans);
    if (weights.w > 0.0f && n_pairs > 0)
        sum += weights.w / (3 * n_pairs) * overlap(n_pairs, pairs, cones, spans);
    if (posture_weight > 0.0f)
        sum += posture_weight * posture_error(posture, poses, first, n_particles);
    sums[lane] = sum;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int half_size = GROUP / 2; half_size > 0; half_size /= 2) {
        if (lane < half_size) sums[lane] += sums[lane + half_size];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (lane == 0) {
        error = seeing > 0.0f ? error / most(seeing, 1.0f) : (vfloat)(weights.x + weights.y);
        float lanes[PACK];
        STORE_PACK((float)n_views * (error + sums[0]), lanes);
        for (int l = 0; l < PACK && first + l < n_particles; ++l) errors[first + l] = lanes[l];
    }
}

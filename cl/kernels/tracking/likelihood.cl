// How badly the poses of particles fit the voxels; twin: reference/likelihood/voxel.py.
// Defines: those of kinematics.h; EDGE_FLOATS; VIEWS, the cameras whose outlines are in local memory at once, at
// most GROUP; NO_DISTORTION if no camera has any; TRUNK, the cone that hides limbs behind it, or -1.
// None depends on a body's size: bodies that differ in that alone share a program.
#if !defined(CAMERA_FLOATS) || !defined(EDGE_FLOATS) || !defined(N_CODES) || !defined(OUTLINE_FLOATS) || \
    !defined(PACK) || !defined(RATIO_STEPS) || !defined(TRUNK) || !defined(VIEWS)
#error "tracking/likelihood.cl needs CAMERA_FLOATS, EDGE_FLOATS, N_CODES, OUTLINE_FLOATS, PACK, RATIO_STEPS, TRUNK and VIEWS"
#endif
#include "common/observed.h"
#include "common/packed_cones.h"
#include "common/posture.h"
#include "common/reduction.h"
#include "tracking/samples.h"

// Items that look at one camera's map.
#define VIEW_LANES (GROUP / VIEWS)
// Numbers in `samples`, and items that add each of them up over a view's.
#define N_SUMS 10
#define ADDERS (VIEW_LANES < 8 ? VIEW_LANES : 8)
// Places between the numbers of neighbouring items: those that are added up together lie in
// different banks of a GPU's memory.
#define APART (GROUP > 1 ? GROUP + 8 : 1)

// The number of an item that begins to count `begin` eighths of the group further on: what needs
// few items is done beside what others do.
static inline int lane_from(int begin)
{
    return (get_local_id(0) + GROUP - begin * GROUP / 8) % GROUP;
}

// Sums of a view's items, in `partial`, N_SUMS x APART, and what ADDERS of them add up, behind that.
INLINED void store_samples(samples sums, __local vint *partial)
{
    __local vint *own = partial + get_local_id(0);
    own[0] = sums.edge;
    own[APART] = sums.n_edge;
    own[2 * APART] = sums.inside;
    own[3 * APART] = sums.n_inside;
    own[4 * APART] = sums.colour;
    own[5 * APART] = sums.n_colour;
    own[6 * APART] = sums.contour;
    own[7 * APART] = sums.n_contour;
    own[8 * APART] = sums.uncovered;
    own[9 * APART] = sums.n_shown;
    barrier(CLK_LOCAL_MEM_FENCE);
}

// Adds up what the items of each view stored: totals (VIEWS, N_SUMS).
INLINED void add_samples(__local const vint *partial, __local vint *added,
                         __local vint *totals)
{
    for (int item = get_local_id(0); item < VIEWS * N_SUMS * ADDERS; item += GROUP) {
        const int adder = item % ADDERS, sum = item / ADDERS;
        __local const vint *first = partial + sum % N_SUMS * APART + sum / N_SUMS * VIEW_LANES;
        vint total = 0;
        for (int lane = adder; lane < VIEW_LANES; lane += ADDERS) total += first[lane];
        added[item] = total;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int sum = get_local_id(0); sum < VIEWS * N_SUMS; sum += GROUP) {
        vint total = 0;
        for (int adder = 0; adder < ADDERS; ++adder) total += added[sum * ADDERS + adder];
        totals[sum] = total;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
}

// What a view's sums say: its error, whether it counts, and its silhouette error alone; and what the
// body leaves uncovered of the surface samples, and whether the view shows any.
typedef struct { vfloat error, seeing, inside, uncovered, showing; } view_error;

INLINED view_error error_of(__local const vint *totals, float2 weights, picture_cues cues)
{
    const vint seen = (totals[1] > 0) & (totals[3] > 0);
    const vfloat edge = TO_FLOAT(totals[0]) / (255.0f * TO_FLOAT(totals[1]));
    const vfloat inside = TO_FLOAT(totals[2]) / (255.0f * TO_FLOAT(totals[3]));
    const vfloat known = most(TO_FLOAT(totals[5]), 1.0f);
    const vfloat colour = TO_FLOAT(totals[4]) / (RATIO_STEPS * known);
    const vfloat outlined = most(TO_FLOAT(totals[7]), 1.0f);
    const vfloat contour = 1.0f - TO_FLOAT(totals[6]) / (255.0f * outlined);
    const vfloat own = weights.x * edge + weights.y * inside - cues.colour_weight * colour +
                       cues.contour_weight * contour;
    const vfloat zero = 0.0f, one = 1.0f;
    const vfloat uncovered = TO_FLOAT(totals[8]) / most(TO_FLOAT(totals[9]), one);
    return (view_error){seen ? own : zero, seen ? one : zero, seen ? inside : zero, uncovered,
                        totals[9] > 0 ? one : zero};
}

// Song et al. eq. (14)-(15) of the cameras from `first_view` on, at most VIEWS of them: the items'
// sums over the rows of all cones become error and 1 of every camera that sees both edge and
// silhouette, else 0 and 0; the first item adds them to its `sum`. The error has, times their
// weights, what the contours that the camera sees along outlines lack of 1 on average, less the mean
// log ratio of the colours that it sees, as a share of its bound. shown: of the first of all cameras.
INLINED void score_views(int first_view, int n_views, int width, int height,
                         __global const float *cameras, __global const uchar *maps,
                         int n_rows, __local const float4 *rows, float2 weights,
                         picture_cues cues, surface_samples shown, __local const vfloat *cones,
                         __local vfloat *outlines, __local vfloat *edges, __local vint *partial,
                         __local view_error *views, view_error *sum)
{
    const int lane = get_local_id(0), here = min(VIEWS, n_views - first_view);
    for (int item = lane; item < here * N_CONES; item += GROUP) {
        cone_outline(cones + item % N_CONES * CONE_FLOATS,
                     cameras + (first_view + item / N_CONES) * CAMERA_FLOATS,
                     outlines + item * OUTLINE_FLOATS);
        if (shown.n > 0)
            outline_edges(outlines + item * OUTLINE_FLOATS, edges + item * EDGE_FLOATS);
    }
    barrier(CLK_LOCAL_MEM_FENCE);

    const int view = lane / VIEW_LANES;
    samples sums = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
    if (view < here) {
        const size_t before = (size_t)(first_view + view) * cues.n_pixels;
        picture_cues own = cues;
        own.codes += before;
        own.contours += 4 * before;
        __global const float *camera = cameras + (first_view + view) * CAMERA_FLOATS;
        for (int item = lane % VIEW_LANES; item < n_rows * SHARES; item += VIEW_LANES) {
            const int r = item / SHARES;
            const int part =
                cues.colour_weight > 0.0f || cues.contour_weight > 0.0f ? cues.row_parts[r] : -1;
            const vint hidden = part < 0 ? (vint)0 : behind_trunk(camera, cones, rows[r]);
            take_row(camera, maps + 2 * before, width,
                     outlines + view * N_CONES * OUTLINE_FLOATS, rows[r], item % SHARES, part, own,
                     hidden, &sums);
        }
        shown.pixels += (first_view + view) * shown.n_points;
        for (int k = lane % VIEW_LANES; k < shown.n; k += VIEW_LANES)
            take_shown(shown, k, edges + view * N_CONES * EDGE_FLOATS, &sums);
    }
    store_samples(sums, partial);
    __local vint *added = partial + N_SUMS * APART, *totals = added + VIEWS * N_SUMS * ADDERS;
    add_samples(partial, added, totals);
    for (int v = lane; v < VIEWS; v += GROUP) {
        const view_error none = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
        views[v] = v < here ? error_of(totals + v * N_SUMS, weights, cues) : none;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (lane == 0)
        for (int v = 0; v < VIEWS; ++v) {
            sum->error += views[v].error;
            sum->seeing += views[v].seeing;
            sum->inside += views[v].inside;
            sum->uncovered += views[v].uncovered;
            sum->showing += views[v].showing;
        }
}

// Sum over this item's share of `n` surface voxels, every `stride`-th from `first` on, after the
// last the first again, of d^2 / (d^2 + scale^2), d the distance to the nearest cone's surface
// (Geman & McClure 1987).
INLINED vfloat unexplained(int n_points, int first, int stride, int n, float scale,
                           __global const float4 *points, __local const vfloat *cones,
                           __local const vfloat *spans)
{
    vfloat sum = 0.0f;
    for (int k = lane_from(2); k < n; k += GROUP) {
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
INLINED vfloat overlap(int n_pairs, __global const int2 *pairs, __local const vfloat *cones,
                       __local const vfloat *spans)
{
    vfloat sum = 0.0f;
    for (int item = lane_from(6); item < 3 * n_pairs; item += GROUP) {
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

// Sum over this item's share of the `hands`, the ends of these cones, of d^2 / (d^2 + reach^2), d the
// distance between a hand and the nearest lower end of what is carried, the cones from `load` on.
INLINED vfloat out_of_grasp(int n_hands, __global const int *hands, int load, float reach,
                            __local const vfloat *cones)
{
    vfloat sum = 0.0f;
    for (int item = lane_from(5); item < n_hands; item += GROUP) {
        __local const vfloat *hand = cones + hands[item] * CONE_FLOATS;
        vfloat nearest = 1e6f;
        for (int c = load; c < N_CONES; ++c) {
            __local const vfloat *part = cones + c * CONE_FLOATS;
            const vfloat x = part[0] - hand[4], y = part[1] - hand[5], z = part[2] - hand[6];
            nearest = least(nearest, sqrt(x * x + y * y + z * z) - part[3]);
        }
        const vfloat ratio = most(nearest - hand[7], 0.0f) / reach;
        sum += ratio * ratio / (1.0f + ratio * ratio);
    }
    return sum;
}

// Numbers of score_poses. weights: of edge, silhouette, surface, overlap. n_rows: of samples on all
// cones. n_points, first_point, stride, scale: surface voxels, those that count, and their distance
// that is half unexplained. load: the first cone of what is carried, reach: the distance of a hand from
// it that is half out of grasp. The mean miss of the most observed points that there could be is added
// with point_weight once per camera, see observed.h.
typedef struct {
    float4 weights;
    int n_particles, n_views, width, height, n_rows, n_points, first_point, stride, n_pairs, n_hands;
    int load;
    float scale, reach, grasp_weight, posture_weight, colour_weight, contour_weight, point_weight;
    float point_reach, exchange, recall_weight;
} score_numbers;

// The exponent of Song et al. eq. (16) with its sign put right: the sum over cameras of edge and
// silhouette error, to which surface, overlap, grasp and posture error are added once per camera.
// Cameras that see no sample are replaced by the mean of the others; if none sees any, by the worst.
// row_table: the rows of samples on all cones, for which `rows` is room. row_parts: of every row, the
// part that is looked for in the pictures' codes and contours, or -1. observed: null, or points, see
// observed.h. pixels: of the surface voxels in every camera; the share of those that count that no
// cone covers, a mean over the cameras that show any, is added with recall_weight once per camera.
// misfits: null, or gets silhouette and surface error alone, means over the cameras. One work-group
// per pack of particles.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void score_poses(// constants
                 score_numbers numbers, __global const float *table,
                 __global const float *cameras, __global const float4 *row_table,
                 __global const int *row_parts, __global const int2 *pairs,
                 __global const int *hands,
                 __global const float4 *posture,
                 // in
                 __global const float *poses, __global const uchar *maps,
                 __global const uchar *contours, __global const uchar *codes,
                 __global const char *ratios, __global const float4 *points,
                 __global const float2 *pixels, __global const float4 *observed,
                 // room
                 __local float4 *rows,
                 // out
                 __global float *errors, __global float *misfits)
{
    __local vfloat turns[2 * N_DOF], frames[N_BONES * FRAME_FLOATS];
    __local vfloat cones[N_CONES * CONE_FLOATS] __attribute__((aligned(64)));
    __local vfloat spans[N_CONES * SPAN_FLOATS] __attribute__((aligned(64)));
    __local float body[BODY_FLOATS];
    __local vfloat outlines[VIEWS * N_CONES * OUTLINE_FLOATS], sums[GROUP];
    __local vfloat edges[VIEWS * N_CONES * EDGE_FLOATS] __attribute__((aligned(64)));
    __local vint partial[N_SUMS * (APART + VIEWS * (ADDERS + 1))];
    __local view_error views[VIEWS];
    const int lane = get_local_id(0), first = get_group_id(0) * PACK;
    for (int r = lane; r < numbers.n_rows; r += GROUP) rows[r] = row_table[r];
    take_cones(table, poses, first, numbers.n_particles, body, turns, frames, cones, spans);

    const int n = (numbers.n_points + numbers.stride - 1) / numbers.stride;
    vfloat missing = 0.0f, sum = 0.0f;
    if (numbers.weights.z > 0.0f || misfits)
        missing = unexplained(numbers.n_points, numbers.first_point, numbers.stride, n,
                              numbers.scale, points, cones, spans) / n;
    if (observed && observed_count(observed) > 0)
        sum += numbers.point_weight / observed_most(observed) *
               missed_by_all(lane_from(4), numbers.point_reach, numbers.exchange, cameras, observed,
                             frames);
    if (numbers.weights.w > 0.0f && numbers.n_pairs > 0)
        sum += numbers.weights.w / (3 * numbers.n_pairs) *
               overlap(numbers.n_pairs, pairs, cones, spans);
    if (numbers.grasp_weight > 0.0f)
        sum += numbers.grasp_weight *
               out_of_grasp(numbers.n_hands, hands, numbers.load, numbers.reach, cones);
    if (numbers.posture_weight > 0.0f)
        sum += numbers.posture_weight * posture_error(lane_from(7), posture, poses, first,
                                                      numbers.n_particles, body, frames);

    const picture_cues cues = {codes, ratios, row_parts, contours, numbers.width * numbers.height,
                               numbers.colour_weight, numbers.contour_weight};
    const surface_samples shown = {pixels, numbers.n_points, numbers.first_point, numbers.stride,
                                   numbers.recall_weight > 0.0f ? n : 0};
    view_error seen = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    for (int view = 0; view < numbers.n_views; view += VIEWS)
        score_views(view, numbers.n_views, numbers.width, numbers.height, cameras, maps,
                    numbers.n_rows, rows, numbers.weights.xy, cues, shown, cones, outlines, edges,
                    partial, views, &seen);
    sum = group_sum_of_packs(sums, sum + numbers.weights.z * missing);
    if (misfits) missing = group_sum_of_packs(sums, missing);
    if (lane == 0) {
        const vfloat n_seeing = most(seen.seeing, 1.0f);
        const vint any = seen.seeing > 0.0f;
        const vfloat error = any ? seen.error / n_seeing : (vfloat)(numbers.weights.x + numbers.weights.y);
        const vfloat misfit = missing + (any ? seen.inside / n_seeing : (vfloat)1.0f);
        const vfloat recall_error =
            seen.showing > 0.0f ? seen.uncovered / most(seen.showing, 1.0f) : (vfloat)1.0f;
        float lanes[PACK], misfit_lanes[PACK];
        STORE_PACK((float)numbers.n_views * (error + sum + numbers.recall_weight * recall_error),
                   lanes);
        STORE_PACK(misfit, misfit_lanes);
        for (int l = 0; l < PACK && first + l < numbers.n_particles; ++l) {
            errors[first + l] = lanes[l];
            if (misfits) misfits[first + l] = misfit_lanes[l];
        }
    }
}

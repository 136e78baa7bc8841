// Gauss-Newton steps of the estimate against surface voxels and observed points; twin:
// reference/filters/refinement.py.
// Minimises strength * mean(d^2 / (d^2 + scale^2)) + sum(((pose - mean) / sigma)^2) over the pose,
// d the distance of a surface voxel to the nearest cone, plus the sum over observed points of
// strength * scale^2 * e^2 / (e^2 + scale^2), e how far they miss, with their own strength and
// scale. The steps weigh voxels by a scale `reach` that shrinks to `scale`, so that those far from
// any cone pull first (graduated non-convexity, Blake & Zisserman 1987), and points likewise. Every
// step is one launch of each kernel.
// Defines: BLOCK, voxels of a work-group, twice its points; GROUP, a power of two; those of
// kinematics.h. The first work-groups of a pose look at voxels, the others at points. A pack is one
// of voxels, the pose the same in all its lanes, or one of columns of the linear system.
#if !defined(BLOCK) || !defined(CAMERA_FLOATS) || !defined(PACK) || !defined(VOXEL_FLOATS)
#error "tracking/refinement.cl needs BLOCK, CAMERA_FLOATS, PACK and VOXEL_FLOATS"
#endif
#include "common/observed.h"
#include "common/packed_cones.h"
#include "common/reduction.h"

// Numbers per row of the linear system: N_DOF derivatives, the distance, zeros up to whole packs.
#define ROW_PACKS ((N_DOF + PACK) / PACK)
#define ROW (ROW_PACKS * PACK)
// What a group of voxels adds to the system, in packs: N_DOF rows, then its share of the cost.
#define PART (N_DOF * ROW_PACKS + 1)
// Rows or columns that an item works on at once, and parts that it waits for together.
#define LINES 4
#define TOGETHER 8
// VOXEL_FLOATS are a voxel's normal, moment (point x normal), distance, square root of its weight
// and nearest cone. A point has two of these, one for each coordinate in the picture: minus its
// gradient is the normal, and N_CONES plus the point's bone stands for the cone.

// How evidence counts. n_points: of the surface. scale, reach: m. point_scale, point_reach: of
// observed points, in deviations; point_root: square root of the weight that one has, in that of a
// voxel; point_share: what its whole miss costs, in the cost of a voxel's; exchange: share of that
// for being taken for its partner.
typedef struct {
    int n_points;
    float scale, reach, point_scale, point_reach, point_root, point_share, exchange;
} evidence_scales;

// What poses are refined on: surface points and observed points, and how they count.
typedef struct {
    evidence_scales scales;
    __global const float4 *points;
    __global const float *cameras;
    __global const float4 *observed;
} evidence;

// What a work-group keeps while it adds a part up.
typedef struct {
    vfloat turns[2 * N_DOF], frames[N_BONES * FRAME_FLOATS], hinges[6 * N_DOF];
    vfloat posed[N_CONES * CONE_FLOATS], spans[N_CONES * SPAN_FLOATS];
    vfloat twists[6 * ROW_PACKS], rows[(BLOCK + 1) * ROW_PACKS];
    float voxels[BLOCK * VOXEL_FLOATS], scratch[GROUP], body[BODY_FLOATS], pose[N_DOF];
} workspace;

// A number that is the same in all lanes.
INLINED float single(__local const vfloat *pack) { return *(__local const float *)pack; }

// Motion of the body by every degree of freedom as its moment and velocity, 6 x ROW: a point p
// with normal n moves by moment . (p x n) + velocity . n along the normal.
INLINED void find_twists(__local const float *body, __local const vfloat *hinges,
                         __local float *twists)
{
    for (int i = get_local_id(0); i < 6 * ROW; i += GROUP) twists[i] = 0.0f;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int a = get_local_id(0); a < N_DOF; a += GROUP) {
        __local const float *free = body + BODY_AXES + a * AXIS_FLOATS;
        const int dof = (int)free[2];
        __local const vfloat *hinge = hinges + 6 * dof;
        for (int i = 0; i < 3; ++i) {
            const int k = (i + 1) % 3, l = (i + 2) % 3;
            const float axis = single(hinge + i);
            const float across = single(hinge + 3 + k) * single(hinge + l) -
                                 single(hinge + 3 + l) * single(hinge + k);
            const bool slides = free[0] < 3.0f;
            twists[i * ROW + dof] = slides ? 0.0f : axis;
            twists[(3 + i) * ROW + dof] = slides ? axis : across;
        }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
}

// What the linear system needs of a voxel, see VOXEL_FLOATS: its normal is the unit gradient of the
// distance; along the side the radius changes.
INLINED void describe(float4 point, float distance, float root, int nearest,
                      __local const vfloat *posed, __local const vfloat *spans,
                      __local float *voxel)
{
    __local const vfloat *cone = posed + nearest * CONE_FLOATS;
    __local const vfloat *span = spans + nearest * SPAN_FLOATS;
    const float p[3] = {point.x, point.y, point.z};
    float along = single(span + 3), u = single(span + 6), v = single(span + 7), normal[3];
    for (int i = 0; i < 3; ++i) {
        along += single(span + i) * p[i];
        u += single(cone + 8 + i) * p[i];
        v += single(cone + 12 + i) * p[i];
    }
    const float t = along < 0.0f ? 0.0f : along < 1.0f ? along : 1.0f;
    const float to_axis = distance + single(cone + 3) + t * single(span + 5);
    const float inverse = 1.0f / (to_axis > 1e-9f ? to_axis : 1e-9f);
    const float lengthwise = along == t ? -single(span + 5)
                                        : (along - t) * single(span + 4) * inverse;
    for (int i = 0; i < 3; ++i)
        normal[i] = (u * single(cone + 8 + i) + v * single(cone + 12 + i)) * inverse +
                    lengthwise * single(span + i);
    for (int i = 0; i < 3; ++i) {
        const int k = (i + 1) % 3, l = (i + 2) % 3;
        voxel[i] = normal[i];
        voxel[3 + i] = p[k] * normal[l] - p[l] * normal[k];
    }
    voxel[6] = distance;
    voxel[7] = root;
    voxel[8] = nearest;
}

// Looks at a pack of the `n` voxels; returns the shares that they leave unexplained. The weight of
// no distance is 1 (Geman & McClure 1987).
INLINED float look_at(__global const float4 *points, int first, int n, float scale,
                      float reach, __local const vfloat *posed, __local const vfloat *spans,
                      __local float *voxels)
{
#define POINT(l) points[lane_index(first, 0x##l, n)]
#define X(l) POINT(l).x
#define Y(l) POINT(l).y
#define Z(l) POINT(l).z
#define THERE(l) POINT(l).w
    const vpoint here = {PACK_OF(vfloat, X), PACK_OF(vfloat, Y), PACK_OF(vfloat, Z)};
    const vint there = PACK_OF(vfloat, THERE) > 0.0f;
    vint nearest = 0;
    vfloat distance = INFINITY;
    for (int c = 0; c < N_CONES; ++c) {
        const vfloat d = packed_distance(posed + c * CONE_FLOATS, spans + c * SPAN_FLOATS, here);
        const vint nearer = d * d < distance * distance;
        distance = nearer ? d : distance;
        nearest = nearer ? c : nearest;
    }
    const vfloat d2 = distance * distance;
    float distances[PACK], roots[PACK], which[PACK], shares[PACK], sum = 0.0f;
    STORE_PACK(distance, distances);
    STORE_PACK(there ? 1.0f / (1.0f + d2 / (reach * reach)) : 0.0f, roots);
    STORE_PACK(TO_FLOAT(nearest), which);
    STORE_PACK(there ? d2 / (d2 + scale * scale) : 1.0f, shares);
    for (int l = 0; l < PACK && first + l < n; ++l) {
        describe(points[first + l], distances[l], roots[l], (int)which[l], posed, spans,
                 voxels + (first + l) * VOXEL_FLOATS);
        sum += shares[l];
    }
    return sum;
}

// A point in a camera: what it misses by, in deviations, and the derivatives of that by the point's
// place; false where it has no image.
typedef struct { float3 at, by[2]; float off[2]; } sighting;

INLINED bool look_from(float4 on, float4 seen, __global const float *cameras,
                       __local const vfloat *frames, sighting *found)
{
    __global const float *camera = cameras + (int)seen.w * CAMERA_FLOATS;
    __local const vfloat *frame = frames + (int)on.x * FRAME_FLOATS;
    float p[3];
    for (int i = 0; i < 3; ++i)
        p[i] = single(frame + 4 * i) * on.y + (single(frame + 4 * i + 1) * on.z +
               (single(frame + 4 * i + 2) * on.w + single(frame + 4 * i + 3)));
    const float3 at = {p[0], p[1], p[2]};
    const float3 right = vload3(0, camera), down = vload3(1, camera), ahead = vload3(2, camera);
    const float depth = dot(ahead, at) + camera[11];
    if (!(depth > 1e-6f)) return false;
    const float inverse = 1.0f / depth;
    const float x = (dot(right, at) + camera[9]) * inverse;
    const float y = (dot(down, at) + camera[10]) * inverse;
    const float3 by_x = (right - x * ahead) * inverse, by_y = (down - y * ahead) * inverse;
    found->at = at;
    found->by[0] = seen.z * (camera[12] * by_x + camera[16] * by_y);
    found->by[1] = seen.z * camera[13] * by_y;
    found->off[0] = seen.z * (camera[12] * x + camera[16] * y + camera[14] - seen.x);
    found->off[1] = seen.z * (camera[13] * y + camera[15] - seen.y);
    return true;
}

static inline float share_missed(bool in_front, const sighting *found, float scale)
{
    const float u = found->off[0] / scale, v = found->off[1] / scale, square = u * u + v * v;
    return in_front ? square / (1.0f + square) : 1.0f;
}

// Looks at observation k, as the point's own or, where that misses less, as its partner's; returns
// the share of its cost.
INLINED float look_at_point(const evidence *e, int k, __local const vfloat *frames,
                            __local float *rows)
{
    const observation one = observed_at(e->observed, k);
    sighting found, as_other;
    bool in_front = look_from(one.own, one.seen, e->cameras, frames, &found);
    float share = share_missed(in_front, &found, e->scales.point_scale), bone = one.own.x;
    if (one.other.x >= 0.0f) {
        const bool other_in_front =
            look_from(one.other, one.seen, e->cameras, frames, &as_other);
        const float other_share =
            e->scales.exchange + (1.0f - e->scales.exchange) *
                          share_missed(other_in_front, &as_other, e->scales.point_scale);
        if (other_share < share) {
            share = other_share;
            found = as_other;
            bone = one.other.x;
            in_front = other_in_front;
        }
    }
    const float reach = e->scales.point_reach;
    const float square = in_front ? found.off[0] * found.off[0] + found.off[1] * found.off[1] : 0;
    const float root = in_front ? e->scales.point_root / (1.0f + square / (reach * reach)) : 0.0f;
    for (int c = 0; c < 2; ++c) {
        __local float *row = rows + c * VOXEL_FLOATS;
        const float3 at = in_front ? found.at : (float3)(0.0f);
        const float3 normal = in_front ? -found.by[c] : (float3)(0.0f);
        vstore3(normal, 0, row);
        vstore3(cross(at, normal), 1, row);
        row[6] = in_front ? found.off[c] : 0.0f;
        row[7] = root;
        row[8] = N_CONES + bone;
    }
    return share;
}

// What the work-group adds to the rows in w->voxels: of BLOCK voxels, or of BLOCK / 2 points;
// returns how many rows these are, and their share of the cost.
INLINED int take_rows(const evidence *e, __local workspace *w, float *cost)
{
    const int lane = get_local_id(0), part = get_group_id(0);
    const int voxel_parts = (e->scales.n_points + BLOCK - 1) / BLOCK;
    float sum = 0.0f;
    int n;
    if (part < voxel_parts) {
        const int first = part * BLOCK;
        n = e->scales.n_points - first < BLOCK ? e->scales.n_points - first : BLOCK;
        for (int k = lane * PACK; k < n; k += GROUP * PACK)
            sum += look_at(e->points + first, k, n, e->scales.scale, e->scales.reach, w->posed, w->spans,
                           w->voxels);
    } else {
        const int first = (part - voxel_parts) * (BLOCK / 2);
        const int left = observed_count(e->observed) - first;
        const int here = left < 0 ? 0 : left < BLOCK / 2 ? left : BLOCK / 2;
        n = 2 * here;
        for (int k = lane; k < here; k += GROUP)
            sum += look_at_point(e, first + k, w->frames, w->voxels + 2 * k * VOXEL_FLOATS);
        sum *= e->scales.point_share;
    }
    *cost = group_sum(w->scratch, sum);  // waits for the rows, too
    return n;
}

// take_pose of the work-group's own pose.
INLINED void take_own_pose(__local workspace *w)
{
    for (int a = get_local_id(0); a < N_DOF; a += GROUP) {
        __local const float *axis = w->body + BODY_AXES + a * AXIS_FLOATS;
        const vfloat value = axis[1] * (vfloat)w->pose[(int)axis[2]];
        w->turns[2 * a] = axis[0] < 3.0f ? value : sin(value);
        w->turns[2 * a + 1] = cos(value);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
}

// Linear system of the work-group's share of the evidence at w->pose, and its share of the cost, as
// a `part`; waits for the pose. moves: (N_CONES + N_BONES) x ROW, 1 where a degree of freedom moves a cone or a bone.
INLINED void add_up(const evidence *e, __global const float *table,
                    __global const vfloat *moves, __local workspace *w, __global vfloat *part)
{
    __local float *numbers = (__local float *)w->rows;
    const int lane = get_local_id(0);
    take_body(table, w->body);
    take_own_pose(w);
    pose_bones(w->turns, w->body, w->frames, w->hinges);
    place_cones(w->body, w->frames, w->posed);
    for (int c = lane; c < N_CONES; c += GROUP)
        cone_span(w->posed + c * CONE_FLOATS, w->spans + c * SPAN_FLOATS);
    find_twists(w->body, w->hinges, (__local float *)w->twists);

    float cost;
    const int n = take_rows(e, w, &cost);
    for (int item = lane; item < n * ROW_PACKS; item += GROUP) {
        const int k = item / ROW_PACKS, j = item % ROW_PACKS;
        __local const float *voxel = w->voxels + k * VOXEL_FLOATS;
        vfloat by = 0.0f;
#pragma unroll
        for (int i = 0; i < 6; ++i) by += voxel[(3 + i) % 6] * w->twists[i * ROW_PACKS + j];
        w->rows[item] = -voxel[7] * moves[(int)voxel[8] * ROW_PACKS + j] * by;
        if (j == N_DOF / PACK) numbers[k * ROW + N_DOF] = voxel[7] * voxel[6];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int item = lane; item < (N_DOF + LINES - 1) / LINES * ROW_PACKS; item += GROUP) {
        const int i = item / ROW_PACKS * LINES, j = item % ROW_PACKS;
        if ((j + 1) * PACK <= i) continue;  // below the diagonal: known from above it
        vfloat sums[LINES];
        for (int r = 0; r < LINES; ++r) sums[r] = 0.0f;
        for (int k = 0; k < n; ++k) {
            const vfloat right = w->rows[k * ROW_PACKS + j];
#pragma unroll
            for (int r = 0; r < LINES; ++r) sums[r] += numbers[k * ROW + i + r] * right;
        }
        for (int r = 0; r < LINES && i + r < N_DOF; ++r) part[(i + r) * ROW_PACKS + j] = sums[r];
    }
    if (lane == 0) part[PART - 1] = cost;
}

// Adds the parts up to the linear system, its upper triangle and right side alone, with those of
// the prior. weight: of one voxel.
INLINED void sum_parts(int n_parts, float weight, __global const vfloat *parts,
                       __global const float *sigma, __global const float *pose,
                       __global const float *mean, __local vfloat *system)
{
    __local float *numbers = (__local float *)system;
    for (int first = get_local_id(0); first < N_DOF * ROW_PACKS; first += LINES * GROUP) {
        vfloat sums[LINES];
        int end[LINES];  // of the parts that say something there
        for (int r = 0; r < LINES; ++r) {
            const int item = first + r * GROUP, i = item / ROW_PACKS, j = item % ROW_PACKS;
            end[r] = i < N_DOF && (j + 1) * PACK > i ? n_parts : 0;
            sums[r] = 0.0f;
        }
        for (int part = 0; part < n_parts; part += TOGETHER)
            for (int p = part; p < part + TOGETHER; ++p)
                for (int r = 0; r < LINES; ++r)
                    if (p < end[r]) sums[r] += parts[p * PART + first + r * GROUP];
        for (int r = 0; r < LINES; ++r)
            if (first + r * GROUP < N_DOF * ROW_PACKS) system[first + r * GROUP] = weight * sums[r];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int dof = get_local_id(0); dof < N_DOF; dof += GROUP) {
        const float prior = 1.0f / (sigma[dof] * sigma[dof]);
        numbers[dof * ROW + dof] += prior;
        numbers[dof * ROW + N_DOF] += prior * (pose[dof] - mean[dof]);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
}

// Solves the N_DOF equations of `system`, their right side in column N_DOF, by Gauss and Jordan's
// method: no step reads what another item writes in it, and no matrix of this kind needs pivots.
// Row i ends as diagonal times the solution's element i. lines: room for 4 ROW numbers.
#if GROUP > 1
// Every item of a GPU keeps its part of the matrix, columns COLUMNS apart of rows ROWS apart, and
// tells the others, in turns of `lines`, of the pivot's row and column.
#define COLUMNS 32
#define ROWS (GROUP / COLUMNS)
#define OWN_ROWS ((N_DOF + ROWS - 1) / ROWS)
#define OWN_COLUMNS ((ROW + COLUMNS - 1) / COLUMNS)
INLINED void solve(__local vfloat *system, __local float *lines)
{
    __local float *numbers = (__local float *)system;
    const int left = get_local_id(0) % COLUMNS, top = get_local_id(0) / COLUMNS;
    float own[OWN_ROWS][OWN_COLUMNS];
#pragma unroll
    for (int r = 0; r < OWN_ROWS; ++r)
#pragma unroll
        for (int c = 0; c < OWN_COLUMNS; ++c) {
            const int i = min(top + r * ROWS, N_DOF - 1), j = min(left + c * COLUMNS, N_DOF);
            own[r][c] = numbers[j < i ? j * ROW + i : i * ROW + j];
        }
    for (int k = 0; k < N_DOF; ++k) {
        __local float *pivot = lines + k % 2 * 2 * ROW, *column = pivot + ROW;
#pragma unroll
        for (int r = 0; r < OWN_ROWS; ++r)
#pragma unroll
            for (int c = 0; c < OWN_COLUMNS; ++c) {
                const int i = top + r * ROWS, j = left + c * COLUMNS;
                if (i == k && j < ROW) pivot[j] = own[r][c];
                if (j == k && i < N_DOF) column[i] = own[r][c];
            }
        barrier(CLK_LOCAL_MEM_FENCE);
        const float inverse = 1.0f / pivot[k];
#pragma unroll
        for (int r = 0; r < OWN_ROWS; ++r) {
            const int i = min(top + r * ROWS, N_DOF - 1);
            const float factor = i == k ? 0.0f : column[i] * inverse;
#pragma unroll
            for (int c = 0; c < OWN_COLUMNS; ++c) {
                const int j = min(left + c * COLUMNS, N_DOF);
                if (j > k) own[r][c] -= factor * pivot[j];
            }
        }
    }
#pragma unroll
    for (int r = 0; r < OWN_ROWS; ++r)
#pragma unroll
        for (int c = 0; c < OWN_COLUMNS; ++c) {
            const int i = top + r * ROWS, j = left + c * COLUMNS;
            if (i < N_DOF && (j == i || j == N_DOF)) numbers[i * ROW + j] = own[r][c];
        }
    barrier(CLK_LOCAL_MEM_FENCE);
}
#else
// What is left of the matrix stays symmetric, so that the upper triangle suffices.
INLINED void solve(__local vfloat *system, __local float *lines)
{
    __local float *numbers = (__local float *)system;
    for (int k = 0; k < N_DOF; ++k) {
        const float inverse = 1.0f / numbers[k * ROW + k];
        for (int i = 0; i < N_DOF; ++i) {
            if (i == k) continue;
            const float factor = numbers[i < k ? i * ROW + k : k * ROW + i] * inverse;
            __local vfloat *row = system + i * ROW_PACKS, *pivot = system + k * ROW_PACKS;
            for (int j = (k + 1) / PACK; j < ROW_PACKS; ++j) row[j] -= factor * pivot[j];
        }
    }
}
#endif

// Keeps the best pose met, which may be this one: its difference from the `mean`, `shift`, and its
// cost, `least`. Where several groups are at the same pose, one of them `tells`.
// strength: that of the voxels' mean.
INLINED void keep_best(bool first, bool tells, int n_parts, float strength,
                       __global const vfloat *parts, __global const float *sigma,
                       __global const float *pose, __global const float *mean,
                       __local float *scratch, __global float *least, __global float *shift)
{
    const int lane = get_local_id(0);
    float cost = 0.0f;
    for (int part = lane; part < n_parts; part += GROUP)
        cost += strength * *(__global const float *)(parts + part * PART + PART - 1);
    for (int dof = lane; dof < N_DOF; dof += GROUP) {
        const float away = (pose[dof] - mean[dof]) / sigma[dof];
        cost += away * away;
    }
    cost = group_sum(scratch, cost);
    const bool better = tells && (first || cost < *least);
    for (int dof = lane; dof < (better ? N_DOF : 0); dof += GROUP)
        shift[dof] = pose[dof] - mean[dof];
    barrier(CLK_GLOBAL_MEM_FENCE);
    if (lane == 0 && better) *least = cost;
}

// A degree of freedom of the pose behind the step that the solved system says.
INLINED float stepped(__local const vfloat *system, __global const float2 *limits,
                      __global const float *pose, int dof)
{
    __local const float *numbers = (__local const float *)system;
    const float step = numbers[dof * ROW + N_DOF] / numbers[dof * ROW + dof];
    return clamp(pose[dof] - step, limits[dof].x, limits[dof].y);
}

// The parts at each of `poses`, along dimension 1: PART packs per work-group.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void refine_system(// constants
                   evidence_scales scales, __global const float *cameras,
                   __global const float *table, __global const vfloat *moves,
                   // in
                   __global const float4 *points, __global const float4 *observed,
                   __global const float *poses,
                   // out
                   __global vfloat *parts)
{
    __local workspace work;
    const evidence e = {scales, points, cameras, observed};
    const int which = get_group_id(1);
    for (int dof = get_local_id(0); dof < N_DOF; dof += GROUP)
        work.pose[dof] = poses[which * N_DOF + dof];
    add_up(&e, table, moves, &work,
           parts + (which * get_num_groups(0) + get_group_id(0)) * PART);
}

// A step from each of `poses`, one per work-group, to `next`.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void refine_step(// constants
                 int first, int n_parts, float strength, float weight,
                 __global const float *sigma, __global const float2 *limits,
                 // in
                 __global const float *means, __global const float *poses,
                 __global const vfloat *parts,
                 // in and out
                 __global float *least, __global float *shifts,
                 // out
                 __global float *next)
{
    __local vfloat system[N_DOF * ROW_PACKS];
    __local float lines[4 * ROW];
    __local float scratch[GROUP];
    const int which = get_group_id(0), offset = which * N_DOF;
    parts += which * n_parts * PART;
    keep_best(first, true, n_parts, strength, parts, sigma, poses + offset, means + offset, scratch,
              least + which, shifts + offset);
    sum_parts(n_parts, weight, parts, sigma, poses + offset, means + offset, system);
    solve(system, lines);
    for (int dof = get_local_id(0); dof < N_DOF; dof += GROUP)
        next[offset + dof] = stepped(system, limits, poses + offset, dof);
}

// Of a step: whether it is the first, strength of a voxel in the cost and its weight in the system.
typedef struct {
    int first;
    float strength, weight;
} step_numbers;

// `refine_step`, and `refine_system` at the pose that it leads to, in one: all work-groups of a
// pose take the same step, each for itself, and the first tells the `next` pose.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void refine_on(// constants
               step_numbers step, evidence_scales scales, __global const float *cameras,
               __global const float *table, __global const vfloat *moves,
               __global const float *sigma, __global const float2 *limits,
               // in
               __global const float4 *points, __global const float4 *observed,
               __global const float *means, __global const float *poses,
               __global const vfloat *parts,
               // in and out
               __global float *least, __global float *shifts,
               // out
               __global float *next, __global vfloat *next_parts)
{
    __local workspace work;
    __local vfloat system[N_DOF * ROW_PACKS];
    __local float lines[4 * ROW];
    const evidence e = {scales, points, cameras, observed};
    const int which = get_group_id(1), offset = which * N_DOF, n_parts = get_num_groups(0);
    parts += which * n_parts * PART;
    keep_best(step.first, get_group_id(0) == 0, n_parts, step.strength, parts, sigma, poses + offset,
              means + offset, work.scratch, least + which, shifts + offset);
    sum_parts(n_parts, step.weight, parts, sigma, poses + offset, means + offset, system);
    solve(system, lines);
    for (int dof = get_local_id(0); dof < N_DOF; dof += GROUP) {
        work.pose[dof] = stepped(system, limits, poses + offset, dof);
        if (get_group_id(0) == 0) next[offset + dof] = work.pose[dof];
    }
    add_up(&e, table, moves, &work, next_parts + (which * n_parts + get_group_id(0)) * PART);
}

// Moves each of `means`, one per work-group, to the best pose met, the last one being that of
// `poses`; the lower triangle of that one's linear system becomes its `information`, row by row.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void refine_end(// constants
                int n_parts, float strength, float weight, __global const float *sigma,
                // in
                __global const float *poses, __global const vfloat *parts,
                // in and out
                __global float *least, __global float *shifts, __global float *means,
                // out
                __global float *information)
{
    __local vfloat system[N_DOF * ROW_PACKS];
    __local float scratch[GROUP];
    const int lane = get_local_id(0), which = get_group_id(0), offset = which * N_DOF;
    parts += which * n_parts * PART;
    information += which * (N_DOF * (N_DOF + 1) / 2);
    keep_best(false, true, n_parts, strength, parts, sigma, poses + offset, means + offset, scratch,
              least + which, shifts + offset);
    sum_parts(n_parts, weight, parts, sigma, poses + offset, means + offset, system);
    for (int dof = lane; dof < N_DOF; dof += GROUP) means[offset + dof] += shifts[offset + dof];
    for (int e = lane; e < N_DOF * N_DOF; e += GROUP) {
        const int i = e / N_DOF, j = e % N_DOF;
        if (j <= i) information[i * (i + 1) / 2 + j] = ((__local float *)system)[j * ROW + i];
    }
}

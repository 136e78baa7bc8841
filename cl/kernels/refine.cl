// Gauss-Newton steps of the estimate against the surface voxels; twin: reference/refine.py.
// Minimises strength * mean(d^2 / (d^2 + scale^2)) + sum(((pose - mean) / sigma)^2) over the pose,
// d the distance of a surface voxel to the nearest cone. The steps weigh voxels by a scale `reach`
// that shrinks to `scale`, so that those far from any cone pull first (graduated non-convexity,
// Blake & Zisserman 1987). Every step is one launch of each kernel.
// Defines: BLOCK, voxels of a work-group; COLUMNS, of the linear system that an item works on at
// once; GROUP, a power of two; those of kinematics.h, PACK being 1.
#include "kinematics.h"
#include "cones.h"
#include "packed_cones.h"
#include "reduction.h"

// Numbers per row of the linear system: N_DOF derivatives, the distance, zeros up to whole blocks.
#define BLOCKS ((N_DOF + COLUMNS) / COLUMNS)
#define ROW (BLOCKS * COLUMNS)
// What a group of voxels adds to the system: N_DOF rows, then its share of the cost.
#define PART (N_DOF * ROW + 1)
// A voxel's normal, moment (point x normal), distance, square root of its weight, nearest cone.
#define VOXEL_FLOATS 9

// Motion of the body by every degree of freedom as its moment and velocity, 6 x ROW: a point p
// with normal n moves by moment . (p x n) + velocity . n along the normal.
inline void find_twists(__local const float *body, __local const float *hinges,
                        __local float *twists)
{
    for (int i = get_local_id(0); i < 6 * ROW; i += GROUP) twists[i] = 0.0f;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int a = get_local_id(0); a < N_DOF; a += GROUP) {
        __local const float *free = body + BODY_AXES + a * AXIS_FLOATS;
        const int dof = (int)free[2];
        const float3 axis = vload3(0, hinges + 6 * dof), place = vload3(0, hinges + 6 * dof + 3);
        const bool slides = free[0] < 3.0f;
        const float3 moment = slides ? (float3)(0.0f) : axis;
        const float3 velocity = slides ? axis : cross(place, axis);
        twists[dof] = moment.x;
        twists[ROW + dof] = moment.y;
        twists[2 * ROW + dof] = moment.z;
        twists[3 * ROW + dof] = velocity.x;
        twists[4 * ROW + dof] = velocity.y;
        twists[5 * ROW + dof] = velocity.z;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
}

// Looks at one voxel: see VOXEL_FLOATS. The weight of no distance is 1 (Geman & McClure 1987).
inline float look_at(float4 point, float reach, __local const float *posed,
                     __local const float *spans, __local float *voxel)
{
    const vpoint here = {point.x, point.y, point.z};
    int nearest = 0;
    float distance = INFINITY;
    for (int c = 0; c < N_CONES; ++c) {
        const float d = packed_distance(posed + c * CONE_FLOATS, spans + c * SPAN_FLOATS, here);
        const bool nearer = fabs(d) < fabs(distance);
        distance = nearer ? d : distance;
        nearest = nearer ? c : nearest;
    }
    const float3 normal = CONE_NORMAL(posed + nearest * CONE_FLOATS, point.xyz);
    vstore3(normal, 0, voxel);
    vstore3(cross(point.xyz, normal), 0, voxel + 3);
    voxel[6] = distance;
    voxel[7] = point.w > 0.0f ? 1.0f / (1.0f + distance * distance / (reach * reach)) : 0.0f;
    voxel[8] = nearest;
    return distance;
}

// Linear system of BLOCK voxels at each of `poses`, along dimension 1, and their share of the cost.
// moves: N_CONES x ROW, 1 where a degree of freedom moves a cone. parts: PART per work-group.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void refine_system(int n_points, float scale, float reach, __global const float4 *points,
                   __global const float *poses, __global const float *table,
                   __global const float *moves, __global float *parts)
{
    __local float turns[2 * N_DOF], frames[N_BONES * FRAME_FLOATS], hinges[6 * N_DOF];
    __local float posed[N_CONES * CONE_FLOATS], spans[N_CONES * SPAN_FLOATS], twists[6 * ROW];
    __local float voxels[BLOCK * VOXEL_FLOATS], rows[BLOCK * ROW], scratch[GROUP];
    __local float body[BODY_FLOATS];
    const int lane = get_local_id(0), first = get_group_id(0) * BLOCK;
    const int n = n_points - first < BLOCK ? n_points - first : BLOCK;
    take_body(table, body);
    take_pose(poses + get_group_id(1) * N_DOF, 0, 1, body, turns);
    pose_bones(turns, body, frames, hinges);
    place_cones(body, frames, posed);
    for (int c = lane; c < N_CONES; c += GROUP)
        cone_span(posed + c * CONE_FLOATS, spans + c * SPAN_FLOATS);
    find_twists(body, hinges, twists);

    float cost = 0.0f;
    for (int k = lane; k < n; k += GROUP) {
        const float4 point = points[first + k];
        const float d = look_at(point, reach, posed, spans, voxels + k * VOXEL_FLOATS);
        cost += point.w > 0.0f ? d * d / (d * d + scale * scale) : 1.0f;
    }
    cost = group_sum(scratch, cost);  // waits for the voxels, too
    for (int item = lane; item < n * BLOCKS; item += GROUP) {
        const int k = item / BLOCKS, j = item % BLOCKS * COLUMNS;
        __local const float *voxel = voxels + k * VOXEL_FLOATS, *twist = twists + j;
        __global const float *moved = moves + (int)voxel[8] * ROW + j;
        for (int c = 0; c < COLUMNS; ++c) {
            const float by =
                twist[c] * voxel[3] + twist[ROW + c] * voxel[4] + twist[2 * ROW + c] * voxel[5] +
                twist[3 * ROW + c] * voxel[0] + twist[4 * ROW + c] * voxel[1] +
                twist[5 * ROW + c] * voxel[2];
            rows[k * ROW + j + c] = voxel[7] * (j + c == N_DOF ? voxel[6] : -moved[c] * by);
        }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    const int group = get_group_id(1) * get_num_groups(0) + get_group_id(0);
    __global float *part = parts + group * PART;
    for (int item = lane; item < N_DOF * BLOCKS; item += GROUP) {
        const int i = item / BLOCKS, j = item % BLOCKS * COLUMNS;
        float sums[COLUMNS];
        for (int c = 0; c < COLUMNS; ++c) sums[c] = 0.0f;
        for (int k = 0; k < n; ++k) {
            const float left = rows[k * ROW + i];
            for (int c = 0; c < COLUMNS; ++c) sums[c] += left * rows[k * ROW + j + c];
        }
        for (int c = 0; c < COLUMNS; ++c) part[i * ROW + j + c] = sums[c];
    }
    if (lane == 0) part[PART - 1] = cost;
}

// Solves the N_DOF equations of `system`, their right side in column N_DOF, by Gauss and Jordan's
// method: no step reads what another item writes in it, and no matrix of this kind needs pivots.
// Row i ends as diagonal times the solution's element i.
inline void solve(__local float *system)
{
    // Some items share a row, so that they find its factor once.
    const int share = GROUP < 8 ? GROUP : 8, lane = get_local_id(0);
    for (int k = 0; k < N_DOF; ++k) {
        const float inverse = 1.0f / system[k * ROW + k];
        for (int i = lane / share; i < N_DOF; i += GROUP / share) {
            const float factor = i == k ? 0.0f : system[i * ROW + k] * inverse;
            for (int j = k + 1 + lane % share; j <= N_DOF; j += share)
                system[i * ROW + j] -= factor * system[k * ROW + j];
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
}

// Takes a step from each of `poses`, one per work-group: the next one into `next`. The best pose met
// is kept as its difference from the mean in `results`, `shift`, and its cost, `least`; the last
// step adds it to the result and leaves the lower triangle of its system as `information`, row by
// row.
// strength: that of the mean over all voxels; weight: of one voxel in the linear system.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void refine_step(int first, int last, int n_parts, float strength, float weight,
                 __global const float *parts, __global const float *sigma,
                 __global const float2 *limits, __global const float *poses,
                 __global float *next, __global float *least, __global float *shift,
                 __global float *information, __global float *results)
{
    __local float system[N_DOF * ROW], scratch[GROUP];
    const int lane = get_local_id(0), which = get_group_id(0);
    __global const float *pose = poses + which * N_DOF;
    __global float *result = results + which * N_DOF;
    parts += which * n_parts * PART;
    next += which * N_DOF;
    least += which;
    shift += which * N_DOF;
    information += which * (N_DOF * (N_DOF + 1) / 2);
    float cost = 0.0f;
    for (int part = lane; part < n_parts; part += GROUP)
        cost += strength * parts[part * PART + PART - 1];
    for (int dof = lane; dof < N_DOF; dof += GROUP) {
        const float away = (pose[dof] - result[dof]) / sigma[dof];
        cost += away * away;
    }
    cost = group_sum(scratch, cost);
    const bool better = first || cost < *least;
    if (better)
        for (int dof = lane; dof < N_DOF; dof += GROUP) shift[dof] = pose[dof] - result[dof];
    barrier(CLK_GLOBAL_MEM_FENCE);
    if (lane == 0 && better) *least = cost;
    if (last)
        for (int dof = lane; dof < N_DOF; dof += GROUP) result[dof] += shift[dof];
    for (int e = lane; e < N_DOF * ROW; e += GROUP) {
        float sum = 0.0f;
        for (int part = 0; part < n_parts; ++part) sum += parts[part * PART + e];
        const int i = e / ROW, j = e % ROW;
        const float prior = 1.0f / (sigma[i] * sigma[i]);
        sum *= weight;
        if (j == i) sum += prior;
        if (j == N_DOF) sum += prior * (pose[i] - result[i]);
        system[e] = sum;
        if (last && j <= i) information[i * (i + 1) / 2 + j] = sum;
    }
    if (last) return;
    barrier(CLK_LOCAL_MEM_FENCE);
    solve(system);
    for (int dof = lane; dof < N_DOF; dof += GROUP) {
        const float step = system[dof * ROW + N_DOF] / system[dof * ROW + dof];
        const float value = pose[dof] - step;
        next[dof] = clamp(value, limits[dof].x, limits[dof].y);
    }
}

// Gauss-Newton steps of the estimate against the surface voxels; twin: reference/refine.py.
// Defines: GROUP, N_STEPS and those of kinematics.h.
#include "kinematics_serial.h"
#include "reduction.h"

#define ROW (N_DOF + 2)

// One row of the linear system: derivatives of the distance of `point` to its nearest cone by the
// degrees of freedom, the distance, and its weight (Geman & McClure 1987), which is 1 for no
// distance.
inline void distance_row(float4 point, float reach, __global const float *posed,
                         __global const float *hinges, __global const uchar *moves,
                         __global float *row)
{
    int nearest = 0;
    float distance = INFINITY;
    for (int c = 0; c < N_CONES; ++c) {
        const float d = CONE_DISTANCE(posed + c * CONE_FLOATS, point.xyz);
        if (fabs(d) < fabs(distance)) {
            distance = d;
            nearest = c;
        }
    }
    const float3 normal = CONE_NORMAL(posed + nearest * CONE_FLOATS, point.xyz);
    for (int dof = 0; dof < N_DOF; ++dof) {
        const uchar kind = moves[nearest * N_DOF + dof];  // 0 not at all, 1 slides, 2 turns
        const float3 axis = vload3(0, hinges + 6 * dof);
        const float3 arm = point.xyz - vload3(0, hinges + 6 * dof + 3);
        row[dof] = kind == 0 ? 0.0f : -dot(normal, kind == 1 ? axis : cross(axis, arm));
    }
    const float share = 1.0f + distance * distance / (reach * reach);
    row[N_DOF] = distance;
    row[N_DOF + 1] = point.w > 0.0f ? 1.0f / (share * share) : 0.0f;
}

// Solves matrix x = vector by Cholesky's method; the lower triangle of `matrix` is overwritten,
// `vector` becomes x.
inline void solve(__local float *matrix, __local float *vector)
{
    const int lane = get_local_id(0);
    for (int k = 0; k < N_DOF; ++k) {
        if (lane == 0) matrix[k * N_DOF + k] = sqrt(matrix[k * N_DOF + k]);
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int i = k + 1 + lane; i < N_DOF; i += GROUP)
            matrix[i * N_DOF + k] /= matrix[k * N_DOF + k];
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int i = k + 1 + lane; i < N_DOF; i += GROUP)
            for (int j = k + 1; j <= i; ++j)
                matrix[i * N_DOF + j] -= matrix[i * N_DOF + k] * matrix[j * N_DOF + k];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (lane == 0) {
        for (int i = 0; i < N_DOF; ++i) {
            for (int j = 0; j < i; ++j) vector[i] -= matrix[i * N_DOF + j] * vector[j];
            vector[i] /= matrix[i * N_DOF + i];
        }
        for (int i = N_DOF - 1; i >= 0; --i) {
            for (int j = i + 1; j < N_DOF; ++j) vector[i] -= matrix[j * N_DOF + i] * vector[j];
            vector[i] /= matrix[i * N_DOF + i];
        }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
}

// Minimises strength * mean(d^2 / (d^2 + scale^2)) + sum(((pose - mean) / sigma)^2)
// over the pose, d the distance of a surface voxel to the nearest cone, from the mean in
// `result`, which the best pose met replaces; shift: by how much. The steps weigh voxels by a
// scale that shrinks from `reach` to `scale`, so that those far from any cone pull first
// (graduated non-convexity, Blake & Zisserman 1987). One work-group.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void refine(int n_points, float scale, float reach, float shrink, float strength,
            __global const float4 *points,
            __global const int4 *bones, __global const float *bone_fixed,
            __global const int4 *axes, __global const float *cones,
            __global const uchar *moves, __global const float *sigma,
            __global const float2 *limits, __global float *pose, __global float *posed,
            __global float *hinges, __global float *rows, __global float *result,
            __global float *shift)
{
    __local float matrix[N_DOF * N_DOF], vector[N_DOF], scratch[GROUP];
    const int lane = get_local_id(0);
    for (int dof = lane; dof < N_DOF; dof += GROUP) {
        pose[dof] = result[dof];
        shift[dof] = 0.0f;
    }
    const float weight = strength / (n_points * scale * scale);
    float least = INFINITY;

    // The last round's step is taken in vain: PoCL 3 miscompiles a loop left between barriers.
    for (int step = 0; step <= N_STEPS; ++step) {
        barrier(CLK_GLOBAL_MEM_FENCE);
        if (lane == 0) {
            float rotations[N_BONES][9], origins[N_BONES][3];
            pose_bones(pose, bones, bone_fixed, axes, rotations, origins, hinges);
            place_cones(cones, rotations, origins, posed);
        }
        barrier(CLK_GLOBAL_MEM_FENCE);

        float cost = 0.0f;
        for (int k = lane; k < n_points; k += GROUP) {
            __global float *row = rows + k * ROW;
            distance_row(points[k], reach, posed, hinges, moves, row);
            const float d2 = row[N_DOF] * row[N_DOF];
            cost += strength / n_points * (points[k].w > 0.0f ? d2 / (d2 + scale * scale) : 1.0f);
        }
        for (int dof = lane; dof < N_DOF; dof += GROUP) {
            const float away = (pose[dof] - result[dof]) / sigma[dof];
            cost += away * away;
        }
        cost = group_sum(scratch, cost);
        if (cost < least) {
            least = cost;
            for (int dof = lane; dof < N_DOF; dof += GROUP) shift[dof] = pose[dof] - result[dof];
        }
        barrier(CLK_GLOBAL_MEM_FENCE);
        for (int e = lane; e < N_DOF * N_DOF; e += GROUP) {
            const int i = e / N_DOF, j = e % N_DOF;
            if (j > i) continue;
            const float prior = 1.0f / (sigma[i] * sigma[i]);
            float sum = 0.0f, right = 0.0f;
            for (int k = 0; k < n_points; ++k) {
                __global const float *row = rows + k * ROW;
                const float weighted = row[N_DOF + 1] * row[i];
                sum += weighted * row[j];
                right += weighted * row[N_DOF];
            }
            matrix[e] = weight * sum + (i == j ? prior : 0.0f);
            if (i == j)
                vector[i] = weight * right + prior * (pose[i] - result[i]);
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        solve(matrix, vector);
        for (int dof = lane; dof < N_DOF; dof += GROUP)
            pose[dof] = clamp(pose[dof] - vector[dof], limits[dof].x, limits[dof].y);
        reach = fmax(scale, reach * shrink);
    }
    barrier(CLK_GLOBAL_MEM_FENCE);
    for (int dof = lane; dof < N_DOF; dof += GROUP) result[dof] += shift[dof];
}

// What the estimate might be besides the mean of the particles: the mean with one limb somewhere
// else. Twin: reference/alternatives.py. Defines: N_DOF, N_LIMBS, GROUP, a power of two.
#include "philox.h"

// Particle 0 is the mean (in `result`); each of the others is the mean with one limb spread by
// 1 (particle 1) to `spread` (particle n - 1) sigma, evenly in the logarithm. Limbs take turns.
// limbs: N_LIMBS x N_DOF, 1 where a degree of freedom belongs to a limb.
__kernel void propose(int n, int layer, float spread, uint2 seed, __global const uint *frame,
                      __global const float *sigma, __global const float2 *limits,
                      __global const uchar *limbs, __global const float *result,
                      __global float *poses)
{
    const int dof = get_global_id(0), particle = get_global_id(1);
    if (dof >= N_DOF || particle >= n) return;
    float value = result[dof];
    if (particle > 0 && limbs[(particle - 1) % N_LIMBS * N_DOF + dof]) {
        const float scale = pow(spread, (float)(particle - 1) / (n > 2 ? n - 2 : 1));
        const vwords counter = {frame[0], layer, particle, dof};
        value += scale * sigma[dof] * LANE_OF(normal_pack(counter, seed), 0);
        const float2 limit = limits[dof];
        value = value < limit.x ? 2.0f * limit.x - value : value;
        value = value > limit.y ? 2.0f * limit.y - value : value;
        value = clamp(value, limit.x, limit.y);
    }
    poses[particle * N_DOF + dof] = value;
}

// candidates: (1 + N_LIMBS) x N_DOF, the mean and, for every limb, the best of the poses that
// moved it. One work-group per candidate.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void choose(int n, __global const float *errors, __global const float *poses,
            __global float *candidates)
{
    __local float least[GROUP];
    __local int where[GROUP];
    const int candidate = get_group_id(0), lane = get_local_id(0);
    float mine = INFINITY;
    int best = 0;
    if (candidate > 0) {
        for (int i = candidate + lane * N_LIMBS; i < n; i += GROUP * N_LIMBS) {
            if (errors[i] < mine) {
                mine = errors[i];
                best = i;
            }
        }
    }
    least[lane] = mine;
    where[lane] = best;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int half_size = GROUP / 2; half_size > 0; half_size /= 2) {
        const int other = lane + half_size;
        if (lane < half_size && least[other] < least[lane]) {
            least[lane] = least[other];
            where[lane] = where[other];
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    for (int dof = lane; dof < N_DOF; dof += GROUP)
        candidates[candidate * N_DOF + dof] = poses[where[0] * N_DOF + dof];
}

// The best of the refined candidates becomes the estimate: candidate 0 unless another one's error
// is smaller by more than the share `margin`. shift: by how much the estimate moved from the mean;
// information: of the candidate taken, see refine.cl.
__kernel void accept(int n_candidates, float margin, __global const float *errors,
                     __global const float *candidates, __global const float *informations,
                     __global float *result, __global float *shift, __global float *information)
{
    const int id = get_global_id(0), n_information = N_DOF * (N_DOF + 1) / 2;
    int best = 0;
    float least = errors[0] * (1.0f - margin);
    for (int i = 1; i < n_candidates; ++i) {
        if (errors[i] < least) {
            least = errors[i];
            best = i;
        }
    }
    if (id < N_DOF) {
        shift[id] = candidates[best * N_DOF + id] - result[id];
        result[id] = candidates[best * N_DOF + id];
    }
    if (id < n_information) information[id] = informations[best * n_information + id];
}

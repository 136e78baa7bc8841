// What the estimate might be besides the mean of the particles: the mean with one limb somewhere
// else. Twin: reference/filters/limb_search.py. Defines: N_DOF; N_LIMBS, at least 1; CANDIDATES, 1
// and two for every limb there is; GROUP, a power of two.
#if !defined(CANDIDATES) || !defined(GROUP) || !defined(N_DOF) || !defined(N_LIMBS)
#error "tracking/limb_search.cl needs CANDIDATES, GROUP, N_DOF and N_LIMBS"
#endif
#include "common/philox.h"

// Particle 0 is the mean (in `result`); each of the others is the mean with one limb elsewhere. In
// the first round, where `best` is null: reach by 1 (particle 1) to `reach` (particle n_near - 1)
// sigma, evenly in the logarithm, or, from particle n_near on, anywhere in its ranges. In later
// rounds: about where the `best` of the round before have it, the candidates of `choose`, with a
// deviation of `reach` sigma; the first of each is that one itself. Limbs take turns. Every run has
// n particles. limbs: N_LIMBS x N_DOF, 1 where a degree of freedom belongs to a limb. seen: null, or
// how far the means would move to observed points, runs x N_DOF: then each limb's first particle
// moves so. layer: tells the rounds' random numbers apart.
__kernel void propose(int n, int n_near, int layer, float reach, __global const uint2 *seeds,
                      __global const uint *frames, __global const float *sigma,
                      __global const float2 *limits, __global const float2 *ranges,
                      __global const uchar *limbs, __global const float *result,
                      __global const float *seen, __global const float *best,
                      __global float *poses)
{
    const int dof = get_global_id(0), particle = get_global_id(1);
    const int run = get_global_id(2);
    if (dof >= N_DOF || particle >= n) return;
    float value = result[run * N_DOF + dof];
    const int limb = (particle - 1) % N_LIMBS;
    if (particle > 0 && limbs[limb * N_DOF + dof]) {
        const uint4 counter = {frames[run], layer, particle, dof};
        const vwords counters = {counter.x, counter.y, counter.z, counter.w};
        const bool near = particle < n_near;
        if (best) {
            const int candidate = 1 + limb + (near ? 0 : N_LIMBS);
            value = best[(run * CANDIDATES + candidate) * N_DOF + dof];
            if (particle - (near ? 1 : n_near) >= N_LIMBS)
                value += reach * sigma[dof] * LANE_OF(normal_pack(counters, seeds[run]), 0);
        } else if (seen && near && particle <= N_LIMBS) {
            value += seen[run * N_DOF + dof];
        } else if (near) {
            const float scale = pow(reach, (float)(particle - 1) / (n_near > 2 ? n_near - 2 : 1));
            value += scale * sigma[dof] * LANE_OF(normal_pack(counters, seeds[run]), 0);
        } else {
            const float share = uniform01(philox4x32(counter, seeds[run]).x);
            value = mix(ranges[dof].x, ranges[dof].y, share);
        }
        const float2 limit = limits[dof];
        value = value < limit.x ? 2.0f * limit.x - value : value;
        value = value > limit.y ? 2.0f * limit.y - value : value;
        value = clamp(value, limit.x, limit.y);
    }
    poses[(run * n + particle) * N_DOF + dof] = value;
}

// candidates: runs x CANDIDATES x N_DOF, the mean and, for every limb, the best of the poses that
// moved it near where it was, then of those that moved it anywhere. One work-group per candidate
// and run.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void choose(int n, int n_near, __global const float *errors, __global const float *poses,
            __global float *candidates)
{
    __local float least[GROUP];
    __local int where[GROUP];
    const int candidate = get_group_id(0), run = get_group_id(1), lane = get_local_id(0);
    errors += run * n;
    poses += run * n * N_DOF;
    candidates += (run * CANDIDATES + candidate) * N_DOF;
    float mine = INFINITY;
    int best = 0;
    if (candidate > 0) {
        const bool near = candidate <= N_LIMBS;
        const int end = near ? n_near : n, limb = (candidate - 1) % N_LIMBS;
        for (int i = (near ? 1 : n_near) + lane; i < end; i += GROUP) {
            if ((i - 1) % N_LIMBS == limb && errors[i] < mine) {
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
        candidates[dof] = poses[where[0] * N_DOF + dof];
}

// The best of a run's refined candidates becomes its estimate: candidate 0 unless another's error
// is smaller by more than a share of it, margins.x where a limb moved near where it was, margins.y
// where it moved anywhere. shift: by how much the estimate moved from the mean; information: of the
// candidate taken, see refinement.cl.
__kernel void accept(float2 margins, __global const float *errors,
                     __global const float *candidates, __global const float *informations,
                     __global float *result, __global float *shift, __global float *information)
{
    const int id = get_global_id(0), n_information = N_DOF * (N_DOF + 1) / 2;
    const int run = get_global_id(1), first = run * CANDIDATES;
    int best = 0;
    float most = 0.0f;
    for (int i = 1; i < CANDIDATES; ++i) {
        const float margin = i > N_LIMBS ? margins.y : margins.x;
        const float gain = errors[first] - margin * fabs(errors[first]) - errors[first + i];
        if (gain > most) {
            most = gain;
            best = i;
        }
    }
    if (id < N_DOF) {
        const float pose = candidates[(first + best) * N_DOF + id];
        shift[run * N_DOF + id] = pose - result[run * N_DOF + id];
        result[run * N_DOF + id] = pose;
    }
    if (id < n_information)
        information[run * n_information + id] = informations[(first + best) * n_information + id];
}

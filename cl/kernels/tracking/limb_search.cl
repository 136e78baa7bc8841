// What the estimate might be besides the mean of the particles: the mean with one limb somewhere
// else. Twin: reference/filters/limb_search.py. Defines: N_DOF; GROUP, a power of two. N_LIMBS, at
// least 1, and CANDIDATES, 1 and two for every limb there is, are arguments, for GPUs defines as
// well, see sizes.h.
#if !defined(GROUP) || !defined(N_DOF)
#error "tracking/limb_search.cl needs GROUP and N_DOF"
#endif
#include "common/philox.h"
#include "tracking/end_frame.h"

#ifndef N_LIMBS
#define N_LIMBS n_limbs
#define CANDIDATES n_candidates
#endif

// A degree of freedom's `value`, reflected at its limits.
static inline float reflected(float value, float2 limit)
{
    value = value < limit.x ? 2.0f * limit.x - value : value;
    value = value > limit.y ? 2.0f * limit.y - value : value;
    return clamp(value, limit.x, limit.y);
}

// The normal number that a round, told by `layer`, has for a particle's degree of freedom.
static inline float noise_of(uint frame, int layer, int particle, int dof, uint2 seed)
{
    const vwords counters = {frame, layer, particle, dof};
    return LANE_OF(normal_pack(counters, seed), 0);
}

// The first round. Particle 0 is the mean (in `result`); each of the others is the mean with one
// limb elsewhere: by 1 (particle 1) to `reach` (particle n_near - 1) sigma, evenly in the logarithm,
// or, from particle n_near on, anywhere in its ranges. Limbs take turns.
// limbs: N_LIMBS x N_DOF, 1 where a degree of freedom belongs to a limb. seen: null, or how far the
// mean would move to observed points, N_DOF: then each limb's first particle moves so.
__kernel void propose(int n_limbs, int n, int n_near, int layer, float reach,
                      __global const uint2 *seed, __global const uint *frame,
                      __global const float *sigma,
                      __global const float2 *limits, __global const float2 *ranges,
                      __global const uchar *limbs, __global const float *result,
                      __global const float *seen, __global float *poses)
{
    const int dof = get_global_id(0), particle = get_global_id(1);
    if (dof >= N_DOF || particle >= n) return;
    float value = result[dof];
    const int limb = (particle - 1) % N_LIMBS;
    if (particle > 0 && limbs[limb * N_DOF + dof]) {
        const bool near = particle < n_near;
        if (seen && near && particle <= N_LIMBS) {
            value += seen[dof];
        } else if (near) {
            const float scale = pow(reach, (float)(particle - 1) / (n_near > 2 ? n_near - 2 : 1));
            value += scale * sigma[dof] * noise_of(*frame, layer, particle, dof, *seed);
        } else {
            const uint4 counter = {*frame, layer, particle, dof};
            const float share = uniform01(philox4x32(counter, *seed).x);
            value = mix(ranges[dof].x, ranges[dof].y, share);
        }
        value = reflected(value, limits[dof]);
    }
    poses[particle * N_DOF + dof] = value;
}

// candidates: CANDIDATES x N_DOF, the mean and, for every limb, the best of the poses that
// moved it near where it was, then of those that moved it anywhere. Where `reach` is positive, these
// poses become those of the next round, told by `layer`: the limb about where the best has it, with
// a deviation of `reach` sigma; the first is the best itself. One work-group per candidate.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void choose(int n_limbs, int n_candidates, int n, int n_near, int layer, float reach,
            __global const uint2 *seed, __global const uint *frame, __global const float *sigma,
            __global const float2 *limits, __global const uchar *limbs,
            __global const float *errors, __global float *poses, __global float *candidates)
{
    __local float least[GROUP], chosen[N_DOF];
    __local int where[GROUP];
    const int candidate = get_group_id(0), lane = get_local_id(0);
    candidates += candidate * N_DOF;
    // The particles that moved the candidate's limb so, every N_LIMBS-th from `first` on.
    const bool near = candidate <= N_LIMBS;
    const int begin = near ? 1 : n_near, end = candidate == 0 ? 0 : near ? n_near : n;
    const int limb = (candidate + N_LIMBS - 1) % N_LIMBS;
    const int first = begin + (limb + N_LIMBS - (begin - 1) % N_LIMBS) % N_LIMBS;
    float mine = INFINITY;
    int best = 0;
    for (int i = first + lane * N_LIMBS; i < end; i += GROUP * N_LIMBS)
        if (errors[i] < mine) {
            mine = errors[i];
            best = i;
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
        candidates[dof] = chosen[dof] = poses[where[0] * N_DOF + dof];
    barrier(CLK_LOCAL_MEM_FENCE);
    const int n_items = reach > 0.0f && first < end ? (end - first + N_LIMBS - 1) / N_LIMBS * N_DOF : 0;
    for (int item = lane; item < n_items; item += GROUP) {
        const int dof = item % N_DOF, particle = first + item / N_DOF * N_LIMBS;
        if (!limbs[limb * N_DOF + dof]) continue;
        float value = chosen[dof];
        if (particle != first)
            value += reach * sigma[dof] * noise_of(*frame, layer, particle, dof, *seed);
        poses[particle * N_DOF + dof] = reflected(value, limits[dof]);
    }
}

// Of the acceptance and the frame's end: relative gains that move a limb near where it was, and
// anywhere; the rest as in end_frame.h.
typedef struct {
    float2 margins;
    float velocity;
    int n_result, n_report;
} end_numbers;

// The best of the refined candidates becomes the estimate: candidate 0 unless another's error
// is smaller by more than a share of it, margins.x where a limb moved near where it was, margins.y
// where it moved anywhere. shift: by how much the estimate moved from the mean; information: of the
// candidate taken, see refinement.cl; misfit: null, or its, of those of all candidates. report: null,
// or the frame ends, see end_frame.h. One work-group.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void accept(// constants
            int n_limbs, int n_candidates, end_numbers end_of,
            // in
            __global const float *errors, __global const float *candidates,
            __global const float *informations, __global const float *all_misfits,
            __global const uint *frame,
            // in and out
            __global float *result, __global float4 *motion,
            // out
            __global float *shift, __global float *information, __global float *misfit,
            __global float *report)
{
    const int n_information = N_DOF * (N_DOF + 1) / 2, lane = get_local_id(0);
    int best = 0;
    float most = 0.0f;
    for (int i = 1; i < CANDIDATES; ++i) {
        const float margin = i > N_LIMBS ? end_of.margins.y : end_of.margins.x;
        const float gain = errors[0] - margin * fabs(errors[0]) - errors[i];
        if (gain > most) {
            most = gain;
            best = i;
        }
    }
    for (int dof = lane; dof < N_DOF; dof += GROUP) {
        const float pose = candidates[best * N_DOF + dof];
        shift[dof] = pose - result[dof];
        result[dof] = pose;
    }
    for (int i = lane; i < n_information; i += GROUP)
        information[i] = informations[best * n_information + i];
    if (lane == 0 && misfit) *misfit = all_misfits[best];
    if (!report) return;
    barrier(CLK_GLOBAL_MEM_FENCE);
    const frame_end end = {end_of.velocity, end_of.n_result, n_information, CANDIDATES * N_DOF,
                           CANDIDATES, frame, result, shift, information, candidates, errors,
                           misfit, motion, report};
    for (int id = lane; id < end_of.n_report; id += GROUP) report_item(&end, id);
}

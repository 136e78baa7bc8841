// One annealing layer's bookkeeping: exponent, weights, resampling, diffusion, mean. Twin:
// reference/annealing.py. Define: GROUP, N_DOF.
#include "philox.h"
#include "reduction.h"

#define WHOLE_SET 0xFFFFFFFFu
#define BISECTIONS 40
// Exponents are searched between 2^-LOG2_BETA_LIMIT and 2^LOG2_BETA_LIMIT.
#define LOG2_BETA_LIMIT 20.0f

inline float group_min(__local float *scratch, float value)
{
    const int lane = get_local_id(0);
    scratch[lane] = value;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int half_size = GROUP / 2; half_size > 0; half_size /= 2) {
        if (lane < half_size) scratch[lane] = fmin(scratch[lane], scratch[lane + half_size]);
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    const float least = scratch[0];
    barrier(CLK_LOCAL_MEM_FENCE);
    return least;
}

// Effective sample size (sum w)^2 / sum w^2 of w = exp(-beta (error - least)).
inline float effective_size(__local float *scratch, int n, __global const float *errors,
                            float least, float beta)
{
    float sum = 0.0f, squares = 0.0f;
    for (int i = get_local_id(0); i < n; i += GROUP) {
        const float w = exp(-beta * (errors[i] - least));
        sum += w;
        squares += w * w;
    }
    sum = group_sum(scratch, sum);
    squares = group_sum(scratch, squares);
    return sum * sum / squares;
}

// Finds beta whose effective sample size is survival_rate * n (by bisection of its logarithm),
// unless a positive one is given, then weights, normalised, and the parents of systematic
// resampling; the last layer of a frame counts it. One work-group.
// result: mean (N_DOF), deviation (N_DOF), then per layer effective sample size, beta, least error.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void anneal(int n, int layer, int last, float survival_rate, float given_beta, uint2 seed,
            __global uint *frame, __global const float *errors, __global float *weights,
            __global float *cumulative, __global int *parents, __global float *result)
{
    __local float scratch[GROUP];
    const int lane = get_local_id(0);

    float least = INFINITY;
    for (int i = lane; i < n; i += GROUP) least = fmin(least, errors[i]);
    least = group_min(scratch, least);

    float low = -LOG2_BETA_LIMIT, high = LOG2_BETA_LIMIT;
    const int steps = given_beta > 0.0f ? 0 : BISECTIONS;
    for (int step = 0; step < steps; ++step) {
        const float middle = 0.5f * (low + high);
        const float size = effective_size(scratch, n, errors, least, exp2(middle));
        if (size > survival_rate * n) low = middle;
        else high = middle;
    }
    const float beta = given_beta > 0.0f ? given_beta : exp2(0.5f * (low + high));
    const float size = effective_size(scratch, n, errors, least, beta);

    // Each lane owns a contiguous run of particles, so that the running sum is one scan.
    const int run = (n + GROUP - 1) / GROUP;
    const int begin = min(lane * run, n), end = min(begin + run, n);
    float sum = 0.0f;
    for (int i = begin; i < end; ++i) {
        weights[i] = exp(-beta * (errors[i] - least));
        sum += weights[i];
    }
    scratch[lane] = sum;
    barrier(CLK_LOCAL_MEM_FENCE);
    float before = 0.0f, total = 0.0f;
    for (int i = 0; i < GROUP; ++i) {
        if (i == lane) before = total;
        total += scratch[i];
    }
    for (int i = begin; i < end; ++i) {
        weights[i] /= total;
        before += weights[i] * total;
        cumulative[i] = before / total;
    }
    barrier(CLK_GLOBAL_MEM_FENCE);

    const float offset =
        uniform01(philox4x32((uint4)(frame[0], layer, WHOLE_SET, 0), seed).x);
    for (int i = lane; i < n; i += GROUP) {
        const float position = (i + offset) / n;
        int first = 0, last = n - 1;  // the first particle whose running sum exceeds position
        while (first < last) {
            const int middle = (first + last) / 2;
            if (cumulative[middle] > position) last = middle;
            else first = middle + 1;
        }
        parents[i] = first;
    }
    barrier(CLK_GLOBAL_MEM_FENCE);
    if (lane == 0) {
        if (last) ++frame[0];
        __global float *diagnostics = result + 2 * N_DOF + 3 * layer;
        diagnostics[0] = size;
        diagnostics[1] = beta;
        diagnostics[2] = least;
    }
}

// Song et al. eq. (11), (13): a child is its parent plus Gaussian noise, reflected at the limits,
// and in the first layer plus the motion that is expected since the last frame.
// Its deviation is noise * sigma, but not above spread * the set's own deviation (result, see
// anneal) where spread is positive.
__kernel void diffuse(int n, int layer, float noise, float spread, uint2 seed,
                      __global const uint *frame, __global const float *sigma,
                      __global const float2 *limits, __global const float *result,
                      __global const float2 *motion, __global const int *parents,
                      __global const float *poses, __global float *children)
{
    const int dof = get_global_id(0), particle = get_global_id(1);
    if (dof >= N_DOF || particle >= n) return;
    const uint4 counter = (uint4)(frame[0], layer, particle, dof);
    float deviation = noise * sigma[dof];
    if (spread > 0.0f) deviation = fmin(deviation, spread * result[N_DOF + dof]);
    float value = poses[parents[particle] * N_DOF + dof] +
                  deviation * philox_normal(counter, seed);
    if (layer == 0) value += motion[dof].y;
    const float2 limit = limits[dof];
    if (value < limit.x) value = 2.0f * limit.x - value;
    if (value > limit.y) value = 2.0f * limit.y - value;
    children[particle * N_DOF + dof] = clamp(value, limit.x, limit.y);
}

// Song et al. eq. (12): weighted mean of the set, and its standard deviation. One work-group per
// degree of freedom.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void estimate(int n, __global const float *weights, __global const float *poses,
              __global float *result)
{
    __local float scratch[GROUP];
    const int dof = get_group_id(0), lane = get_local_id(0);
    float sum = 0.0f;
    for (int i = lane; i < n; i += GROUP) sum += weights[i] * poses[i * N_DOF + dof];
    const float centre = group_sum(scratch, sum);
    float squares = 0.0f;
    for (int i = lane; i < n; i += GROUP) {
        const float offset = poses[i * N_DOF + dof] - centre;
        squares += weights[i] * offset * offset;
    }
    squares = group_sum(scratch, squares);
    if (lane == 0) {
        result[dof] = centre;
        result[N_DOF + dof] = sqrt(squares);
    }
}

// Ends a frame: what to add to the particles before the next one, which is how far the estimate
// was moved after the mean was taken (shift) and `velocity` times the change since the last frame.
// motion: N_DOF x (last estimate, what to add).
__kernel void settle(float velocity, __global const uint *frame, __global const float *result,
                     __global const float *shift, __global float2 *motion)
{
    const int dof = get_global_id(0);
    if (dof >= N_DOF) return;
    const float pose = result[dof];
    // The first frame's change is the start's error, not a motion.
    const float change = frame[0] > 1 ? pose - motion[dof].x : 0.0f;
    motion[dof] = (float2)(pose, shift[dof] + velocity * change);
}

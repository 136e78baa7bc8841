// One annealing layer's bookkeeping: exponent, weights, resampling, diffusion, mean; of several
// runs at once, whose particles follow each other and do not mix. Twin:
// reference/filters/annealing.py. Defines: N_DOF; GROUP, a power of two; for `anneal` N_BETAS,
// ROUNDS and RUN, the greatest number of packs of an item; LOG2_BETA_LIMIT: exponents are searched
// between 2^-LOG2_BETA_LIMIT and 2^LOG2_BETA_LIMIT; that of pack.h.
#if !defined(LOG2_BETA_LIMIT) || !defined(N_BETAS) || !defined(N_DOF) || !defined(PACK) || \
    !defined(ROUNDS) || !defined(RUN)
#error "tracking/annealing.cl needs LOG2_BETA_LIMIT, N_BETAS, N_DOF, PACK, ROUNDS and RUN"
#endif
#include "common/philox.h"
#include "common/reduction.h"
#include "tracking/end_frame.h"

#define WHOLE_SET 0xFFFFFFFFu

// Effective sample sizes (sum w)^2 / sum w^2 at N_BETAS exponents are found together.
#define SUMS (2 * N_BETAS)

// Number of packs of an item among n particles. Where an item has all of them, one program serves
// many n; where a group shares them, the loops over them are unrolled.
#if GROUP == 1
#define PACKS(n) (((n) + PACK - 1) / PACK)
#else
#define PACKS(n) RUN
#endif

INLINED float group_min(__local float *scratch, float value)
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

// Replaces SUMS values of every item by their sums over the group; eight at a time, since
// barriers are what it costs. scratch: SUMS x GROUP.
INLINED void group_sums(__local float *scratch, float values[SUMS])
{
    const int lane = get_local_id(0);
    for (int v = 0; v < SUMS; ++v) scratch[v * GROUP + lane] = values[v];
    barrier(CLK_LOCAL_MEM_FENCE);
    int length = GROUP;
#pragma unroll
    for (; length > 8; length /= 8) {
        const int next = length / 8;
        for (int item = lane; item < SUMS * next; item += GROUP) {
            __local float *first = scratch + item / next * GROUP + item % next;
            float sum = 0.0f;
            for (int part = 0; part < 8; ++part) sum += first[part * next];
            *first = sum;
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    for (int v = 0; v < SUMS; ++v) {
        values[v] = 0.0f;
        for (int i = 0; i < length; ++i) values[v] += scratch[v * GROUP + i];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
}

// Adds up w = exp(-beta excess) and w^2 of this item's packs.
static inline void weigh(const vfloat excess[RUN], int packs, float beta, float *sum,
                         float *squares)
{
    vfloat total = 0.0f, total2 = 0.0f;
    for (int k = 0; k < packs; ++k) {
        const vfloat w = exp(-beta * excess[k]);
        total += w;
        total2 += w * w;
    }
    *sum = PACK_SUM(total);
    *squares = PACK_SUM(total2);
}

// The logarithm of beta whose effective sample size is `wanted`: the interval shrinks to the part
// between two of N_BETAS exponents in it, ROUNDS times.
INLINED float find_exponent(__local float *scratch, const vfloat excess[RUN], int packs,
                           float wanted)
{
    float low = -LOG2_BETA_LIMIT, width = 2.0f * LOG2_BETA_LIMIT;
    for (int round = 0; round < ROUNDS; ++round) {
        width /= N_BETAS + 1;
        float sums[SUMS];
        for (int b = 0; b < N_BETAS; ++b)
            weigh(excess, packs, exp2(low + (b + 1) * width), &sums[2 * b], &sums[2 * b + 1]);
        group_sums(scratch, sums);
        int parts = 0;  // whose effective sample size is too large
        for (int b = 0; b < N_BETAS; ++b)
            parts += parts == b && sums[2 * b] * sums[2 * b] > wanted * sums[2 * b + 1];
        low += parts * width;
    }
    return low + 0.5f * width;
}

// Sum of `value` over the items before this one; *through gets it with its own.
INLINED float sum_before(__local float *scratch, float value, float *through)
{
    const int lane = get_local_id(0);
    scratch[lane] = value;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int reach = 1; reach < GROUP; reach *= 2) {
        const float more = lane >= reach ? scratch[lane - reach] : 0.0f;
        barrier(CLK_LOCAL_MEM_FENCE);
        scratch[lane] += more;
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    *through = scratch[lane];
    return lane ? scratch[lane - 1] : 0.0f;
}

// The first child at or behind `share` of the total weight: children stand at (i + offset) / n.
static inline int first_child(float share, float offset, int n)
{
    const int child = (int)ceil(share * n - offset);
    return child < 0 ? 0 : child < n ? child : n;
}

// The n particles in a layer, and what their random numbers are made of.
typedef struct { int n, layer; uint frame; uint2 seed; } layer_state;

// Finds beta whose effective sample size is survival_rate * n, unless a positive one is given, then
// weights, normalised, and the parents of systematic resampling. A work-group finds those of all of
// particles, an item those of PACKS(n) packs that follow each other, and writes `weights` of the
// particles and `parents` of the children from number `begin` up to `end`. diagnostics: effective
// sample size, beta, least error, written by the group that begins with 0.
INLINED void find_parents(layer_state state, float survival_rate, float given_beta, int begin,
                          int end, __local float *scratch, __global const float *errors,
                          __global float *weights, __global int *parents,
                          __global float *diagnostics)
{
    const int n = state.n, lane = get_local_id(0), packs = PACKS(n), mine = lane * packs * PACK;
    vfloat excess[RUN];
    float lowest = INFINITY;
    for (int k = 0; k < packs; ++k) {
        const int i = mine + k * PACK;
        // Beyond the last particle: of no weight.
#define ERROR(l) (i + 0x##l < n ? errors[i + 0x##l] : INFINITY)
        excess[k] = PACK_OF(vfloat, ERROR);
#undef ERROR
        float lanes[PACK];
        STORE_PACK(excess[k], lanes);
        for (int l = 0; l < PACK; ++l) lowest = lanes[l] < lowest ? lanes[l] : lowest;
    }
    lowest = group_min(scratch, lowest);
    for (int k = 0; k < packs; ++k) excess[k] -= lowest;

    const float beta = given_beta > 0.0f
                           ? given_beta
                           : exp2(find_exponent(scratch, excess, packs, survival_rate * n));
    float sums[SUMS];
    for (int v = 2; v < SUMS; ++v) sums[v] = 0.0f;
    weigh(excess, packs, beta, &sums[0], &sums[1]);
    float through;
    const float before = sum_before(scratch, sums[0], &through);
    barrier(CLK_LOCAL_MEM_FENCE);
    group_sums(scratch, sums);
    const float total = sums[0];

    const uint4 counter = {state.frame, state.layer, WHOLE_SET, 0};
    const float offset = uniform01(philox4x32(counter, state.seed).x);
    float running = before;
    int child = first_child(before / total, offset, n);
    for (int k = 0; k < packs; ++k) {
        float lanes[PACK];
        STORE_PACK(exp(-beta * excess[k]), lanes);
        for (int l = 0; l < PACK && mine + k * PACK + l < n; ++l) {
            const int i = mine + k * PACK + l;
            if (i >= begin && i < end) weights[i] = lanes[l] / total;
            running += lanes[l];
            // An item's last particle ends where the next item's first one begins.
            const bool ends = k == packs - 1 && l == PACK - 1;
            const float share = (ends || running > through ? through : running) / total;
            const int next = i == n - 1 ? n : first_child(share, offset, n);
            const int last = next < end ? next : end;
            for (int c = child > begin ? child : begin; c < last; ++c) parents[c] = i;
            child = next > child ? next : child;
        }
    }
    if (lane == 0 && begin == 0) {
        diagnostics[0] = sums[0] * sums[0] / sums[1];
        diagnostics[1] = beta;
        diagnostics[2] = lowest;
    }
    barrier(CLK_GLOBAL_MEM_FENCE);
}

// A layer's exponent, weights and parents; the last layer of a frame counts it. One work-group.
// result: mean (N_DOF), deviation (N_DOF), then per layer effective sample size, beta, least error.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void anneal(int n, int layer, int last, float survival_rate, float given_beta,
            __global const uint2 *seed, __global uint *frame, __global const float *errors,
            __global float *weights, __global int *parents, __global float *result)
{
    __local float scratch[SUMS * GROUP];
    const layer_state state = {n, layer, *frame, *seed};
    find_parents(state, survival_rate, given_beta, 0, n, scratch, errors, weights, parents,
                 result + 2 * N_DOF + 3 * layer);
    if (last && get_local_id(0) == 0) *frame = state.frame + 1;
}

#define DOF(l) lane_index(first, 0x##l, N_DOF)
#define SIGMA(l) sigma[DOF(l)]
#define POSE(l) parent[DOF(l)]
#define MOTION(l) motion[DOF(l)].y
#define LOWER(l) limits[DOF(l)].x
#define UPPER(l) limits[DOF(l)].y

// Song et al. eq. (11): a child is its parent plus Gaussian noise and `change`, reflected at the
// limits. A pack of its degrees of freedom, from number `first` on.
static inline void make_child(layer_state state, int particle, int first, vfloat deviation,
                              vfloat change, __global const float2 *limits,
                              __global const float *parent, __global float *child)
{
    const vuint whole = 0;
    const vwords counter = {whole + state.frame, whole + (uint)state.layer,
                            whole + (uint)particle, PACK_OF(vuint, DOF)};
    vfloat value = PACK_OF(vfloat, POSE) + deviation * normal_pack(counter, state.seed) + change;
    const vfloat lower = PACK_OF(vfloat, LOWER), upper = PACK_OF(vfloat, UPPER);
    value = value < lower ? 2.0f * lower - value : value;
    value = value > upper ? 2.0f * upper - value : value;
    float lanes[PACK];
    STORE_PACK(within(value, lower, upper), lanes);
    for (int l = 0; l < PACK && first + l < N_DOF; ++l) child[first + l] = lanes[l];
}

// Song et al. eq. (11), (13): the children; in the first layer they move by what is expected since
// the last frame.
// The noise's deviation is noise * the layer's row of sigmas. An item works on PACK degrees of
// freedom of a particle.
__kernel void diffuse(int n, int layer, float noise, __global const uint2 *seed,
                      __global const uint *frame, __global const float *sigmas,
                      __global const float2 *limits, __global const float4 *motion,
                      __global const int *parents, __global const float *poses,
                      __global float *children)
{
    const int first = get_global_id(0) * PACK, particle = get_global_id(1);
    if (first >= N_DOF || particle >= n) return;
    __global const float *sigma = sigmas + layer * N_DOF;
    vfloat deviation = noise * PACK_OF(vfloat, SIGMA), change = 0.0f;
    if (layer == 0) change = PACK_OF(vfloat, MOTION);
    const layer_state state = {n, layer, *frame, *seed};
    make_child(state, particle, first, deviation, change, limits,
               poses + parents[particle] * N_DOF, children + particle * N_DOF);
}

// `anneal` of a layer that is not a frame's last and `diffuse` of the next, with its noise, in one:
// each work-group anneals by itself and makes `share` of the children.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void anneal_diffuse(int n, int layer, float noise, int share, float survival_rate,
                    __global const uint2 *seed, __global const uint *frame,
                    __global const float *sigmas, __global const float2 *limits,
                    __global const float *errors, __global const float *poses,
                    __global float *weights, __global int *parents, __global float *result,
                    __global float *children)
{
    __local float scratch[SUMS * GROUP];
    const int n_packs = (N_DOF + PACK - 1) / PACK;
    const int begin = get_group_id(0) * share, end = begin + share < n ? begin + share : n;
    layer_state state = {n, layer, *frame, *seed};
    find_parents(state, survival_rate, 0.0f, begin, end, scratch, errors, weights, parents,
                 result + 2 * N_DOF + 3 * layer);
    ++state.layer;
    __global const float *sigma = sigmas + state.layer * N_DOF;
    for (int item = get_local_id(0); item < (end - begin) * n_packs; item += GROUP) {
        const int particle = begin + item / n_packs, first = item % n_packs * PACK;
        make_child(state, particle, first, noise * PACK_OF(vfloat, SIGMA), 0.0f, limits,
                   poses + parents[particle] * N_DOF, children + particle * N_DOF);
    }
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

// Ends a frame, see end_frame.h.
__kernel void end_frame(float velocity, int n_result, int n_information,
                        int n_candidates, int n_errors,
                        __global const uint *frame, __global const float *result,
                        __global const float *shift, __global const float *information,
                        __global const float *candidates, __global const float *errors,
                        __global const float *misfit, __global float4 *motion,
                        __global float *report)
{
    const frame_end end = {velocity, n_result, n_information, n_candidates, n_errors, frame,
                           result, shift, information, candidates, errors, misfit, motion, report};
    report_item(&end, get_global_id(0));
}

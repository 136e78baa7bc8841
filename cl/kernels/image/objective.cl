// From counted pixels to the objective functions of Rymut 2016, 4.6; twin:
// reference/image_objective/objective.py. Define: GROUP.
#ifndef GROUP
#error "image/objective.cl needs GROUP"
#endif
#include "common/sizes.h"

#define WORDS ((WIDTH + 31) / 32)
#define N_COUNTS 4

// Of feature maps (V, HEIGHT, WIDTH) uchar2 (silhouette, edge proximity) what is compared with
// rendered parts: silhouettes (V, WORDS, pitch) as bits and the proximity alone, within the regions
// of interest roi (V, 4), ends excluded, which are copied to regions.
__kernel void pack_maps(int2 picture, int pitch, __global const uchar2 *maps,
                        __global const int4 *roi, __global int4 *regions,
                        __global uint *silhouettes, __global uchar *proximity)
{
    const int row = get_global_id(0), word = get_global_id(1), view = get_global_id(2);
    if (word >= WORDS || row >= pitch) return;
    const int4 region = roi[view];
    if (word == 0 && row == 0) regions[view] = region;
    const size_t at = ((size_t)view * HEIGHT + row) * WIDTH;
    uint bits = 0;
    const int first = max(32 * word, region.x), last = min(32 * word + 32, region.z);
    if (row >= region.y && row < region.w)
        for (int x = first; x < last; ++x) {
            const uchar2 value = maps[at + x];
            proximity[at + x] = value.y;
            bits |= (uint)(value.x > 127) << (x - 32 * word);
        }
    silhouettes[((size_t)view * WORDS + word) * pitch + row] = bits;
}

// areas (V,): set bits of each silhouette (V, n_words). Eq. (4.29), (4.36).
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void silhouette_areas(int n_words, __global const uint *silhouettes, __global int *areas)
{
    const int lane = get_local_id(0);
    __global const uint *words = silhouettes + (size_t)get_group_id(0) * n_words;
    __local int total;
    if (lane == 0) total = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    int sum = 0;
    for (int i = lane; i < n_words; i += GROUP) sum += popcount(words[i]);
    atomic_add(&total, sum);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (lane == 0) areas[get_group_id(0)] = total;
}

// Kinds of objective functions, in the order of OBJECTIVE_KINDS.
enum { WS, SP, AO_WS, AO_SP, PO_SP };

static inline float ratio(float part, float whole) { return whole > 0.0f ? part / whole : 0.0f; }

// Eq. (4.46)-(4.50) for one camera or, with sums over the cameras, for all. weights: b, w1, w2.
static inline float joined(int kind, float f1, float f2, float4 weights)
{
    if (kind == WS || kind == AO_WS) return weights.y * f1 + weights.z * f2;
    return pow(f1, weights.y) * pow(f2, weights.z);
}

// errors (N,): 1 - f, from counts (V, N, N_COUNTS) of count_pixels and the silhouettes' areas
// (V,). weights: b, w1, w2.
__kernel void score_counts(int kind, int n_particles, int n_views, float4 weights,
                           __global const int *areas, __global const int *counts,
                           __global float *errors)
{
    const int particle = get_global_id(0);
    if (particle >= n_particles) return;
    const bool together = kind == WS || kind == SP;
    const int n_parts = together ? 1 : n_views, n_together = together ? n_views : 1;
    float f = kind == PO_SP ? 1.0f : 0.0f;
    for (int i = 0; i < n_parts; ++i) {
        float edge = 0.0f, near_edge = 0.0f, image = 0.0f, model = 0.0f, overlap = 0.0f;
        for (int v = i; v < i + n_together; ++v) {
            __global const int *count = counts + ((size_t)v * n_particles + particle) * N_COUNTS;
            edge += count[0];
            near_edge += count[1] / 255.0f;
            image += areas[v];
            model += count[2];
            overlap += count[3];
        }
        const float f1 =
            weights.x * ratio(overlap, image) + (1.0f - weights.x) * ratio(overlap, model);
        const float value = joined(kind, f1, ratio(near_edge, edge), weights);
        f = kind == PO_SP ? f * value : f + value / n_parts;
    }
    errors[particle] = 1.0f - f;
}

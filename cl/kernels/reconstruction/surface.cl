// From occupied voxels to surface voxels: removal of the inside, stream compaction in ascending
// order. Twin: psfs/reference/surface.py. Defines: LANES; CLOSED (0 or 1).
// Occupied voxels are bits: WORDS ushorts per row along z, voxel z is bit z % 16 of word z / 16.
#if !defined(CLOSED) || !defined(LANES)
#error "reconstruction/surface.cl needs CLOSED and LANES"
#endif
#include "common/lanes.h"
#include "common/sizes.h"
#define WORDS ((NZ + 15) / 16)

// The voxels of a word that are occupied together with both neighbours along z.
static inline uint within_row(int3 grid, __global const ushort *restrict bits, int at, int word)
{
    const uint here = bits[at];
    const uint below = word > 0 ? bits[at - 1] >> 15 : 0;
    const uint above = word < WORDS - 1 ? (uint)bits[at + 1] << 15 : 0;
    return (here << 1 | below) & here & (here >> 1 | above);
}

// The occupied voxels of a word that have an empty neighbour or lie on the grid's border: one of 26
// neighbours if CLOSED, else of 6.
static inline uint surface_bits(int3 grid, __global const ushort *restrict bits,
                                int x, int y, int word)
{
    const int at = (x * NY + y) * WORDS + word;
    const uint here = bits[at];
    if (here == 0 || x == 0 || x == NX - 1 || y == 0 || y == NY - 1) return here;
    uint enclosed = within_row(grid, bits, at, word) & bits[at - WORDS] & bits[at + WORDS] &
                    bits[at - NY * WORDS] & bits[at + NY * WORDS];
    if (CLOSED && enclosed != 0) {
        // Unrolled, the loads do not wait for each other.
#pragma unroll
        for (int dx = -1; dx <= 1; ++dx)
#pragma unroll
            for (int dy = -1; dy <= 1; ++dy)
                enclosed &= within_row(grid, bits, at + (dx * NY + dy) * WORDS, word);
    }
    return here & ~enclosed;
}

// One work-group per slab of rows with the same x: where each row's surface voxels start within
// the slab, and the slab's numbers of surface and occupied voxels.
__kernel void count_slabs(int3 grid, __global const ushort *restrict bits, __global int *restrict starts,
                          __global int2 *restrict totals)
{
    __local int2 sums[LANES];
    const int lane = get_local_id(0), x = get_group_id(0);
    const int share = (NY + LANES - 1) / LANES;
    const int first = lane * share, end = first + share < NY ? first + share : NY;
    int2 sum = (int2)(0, 0);
    for (int y = first; y < end; ++y) {
        starts[x * NY + y] = sum.x;
        for (int word = 0; word < WORDS; ++word) {
            const uint occupied = bits[(x * NY + y) * WORDS + word];
            if (occupied == 0) continue;
            sum.x += popcount(surface_bits(grid, bits, x, y, word));
            sum.y += popcount(occupied);
        }
    }
    sums[lane] = sum;
    SYNC;
    int before = 0;
    for (int other = 0; other < lane; ++other) before += sums[other].x;
    for (int y = first; y < end; ++y) starts[x * NY + y] += before;
    if (lane < LANES - 1) return;
    int volume = 0;
    for (int other = 0; other < LANES; ++other) volume += sums[other].y;
    totals[x] = (int2)(before + sum.x, volume);
}

// Write the flat indices of the surface voxels, one work-group per slab. `found` is all of them,
// n_surface those that the list has room for.
__kernel void list_surface(int3 grid, int capacity,
                           __global const ushort *restrict bits,
                           __global const int *restrict starts,
                           __global const int2 *restrict totals, __global int *restrict n_surface,
                           __global int *restrict n_occupied, __global int *restrict found,
                           __global int *restrict indices)
{
    __local int2 sums[LANES];
    __local int bases[LANES];
    const int lane = get_local_id(0), x = get_group_id(0);
    int base = 0;
    int2 sum = (int2)(0, 0);
    for (int slab = lane; slab < NX; slab += LANES) {
        base += slab < x ? totals[slab].x : 0;
        sum += totals[slab];
    }
    bases[lane] = base;
    sums[lane] = sum;
    SYNC;
    base = 0;
    for (int other = 0; other < LANES; ++other) base += bases[other];
    if (x == 0 && lane == 0) {
        int2 all = (int2)(0, 0);
        for (int other = 0; other < LANES; ++other) all += sums[other];
        *found = all.x;
        *n_surface = all.x < capacity ? all.x : capacity;
        *n_occupied = all.y;
    }
    if (totals[x].x == 0) return;
    for (int y = lane; y < NY; y += LANES) {
        int at = base + starts[x * NY + y];
        const int end = y + 1 < NY ? base + starts[x * NY + y + 1] : base + totals[x].x;
        for (int word = 0; word < WORDS && at < end; ++word)
            for (uint left = surface_bits(grid, bits, x, y, word); left != 0; left &= left - 1u) {
                const int z = word * 16 + 31 - (int)clz(left & (0u - left));
                if (at < capacity) indices[at] = (x * NY + y) * NZ + z;
                ++at;
            }
    }
}

#ifdef SAMPLES
// Mean position of SAMPLES evenly listed surface voxels, in voxels from the grid's corner, and how
// many surface voxels there are. One work-group.
__kernel void mean_position(int3 grid, __global const int *restrict indices,
                            __global const int *restrict n_surface, __global float *restrict mean)
{
    __local float4 sums[LANES];
    const int lane = get_local_id(0), n = *n_surface;
    const int samples = n < SAMPLES ? n : SAMPLES;
    float4 sum = (float4)(0.0f);
    for (int k = lane; k < samples; k += LANES) {
        const int voxel = indices[(int)((long)k * n / samples)];
        sum += (float4)(voxel / (NY * NZ) + 0.5f, voxel / NZ % NY + 0.5f, voxel % NZ + 0.5f, 0.0f);
    }
    sums[lane] = sum;
    SYNC;
    if (lane > 0) return;
    for (int other = 1; other < LANES; ++other) sum += sums[other];
    if (samples > 0) sum /= samples;
    sum.w = n;
    vstore4(sum, 0, mean);
}
#endif

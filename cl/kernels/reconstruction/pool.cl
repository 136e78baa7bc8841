// Reading the probability of a sparse grid, see occupancy.cl: the pool holds that of the voxels of
// the listed bricks. Twin: psfs/reference/surface.py. Defines: BX BY BZ, voxels of a brick.
#if !defined(BX) || !defined(BY) || !defined(BZ)
#error "reconstruction/pool.cl needs BX, BY and BZ"
#endif
#include "common/sizes.h"

#define BRICK_VOXELS (BX * BY * BZ)
#define BRICKS_Y ((NY + BY - 1) / BY)
#define BRICKS_Z ((NZ + BZ - 1) / BZ)

// Dense copy of the pool, 0 where there is no brick.
__kernel void spread(int3 grid, int capacity, __global const float *restrict pool,
                     __global const int *restrict slots,
                     __global float *restrict probability)
{
    const int z = get_global_id(0), y = get_global_id(1), x = get_global_id(2);
    if (z >= NZ || y >= NY || x >= NX) return;
    const int slot = slots[(x / BX * BRICKS_Y + y / BY) * BRICKS_Z + z / BZ];
    const int within = ((x % BX) * BY + y % BY) * BZ + z % BZ;
    probability[(x * NY + y) * NZ + z] =
        slot >= 0 && slot < capacity ? pool[slot * BRICK_VOXELS + within] : 0.0f;
}

// Probabilities of the surface voxels, in their order: the threshold where there was no room.
__kernel void sparse_gather(int3 grid, int capacity, float threshold,
                            __global const float *restrict pool,
                            __global const int *restrict slots,
                            __global const int *restrict indices,
                            __global const int *restrict n_surface, __global float *restrict out)
{
    const int n = *n_surface;
    for (int i = get_global_id(0); i < n; i += get_global_size(0)) {
        const int x = indices[i] / (NY * NZ), y = indices[i] / NZ % NY, z = indices[i] % NZ;
        const int slot = slots[(x / BX * BRICKS_Y + y / BY) * BRICKS_Z + z / BZ];
        const int within = ((x % BX) * BY + y % BY) * BZ + z % BZ;
        out[i] = slot < capacity ? pool[slot * BRICK_VOXELS + within] : threshold;
    }
}

// Where voxels are. geometry: the grid's origin (3) and the voxels' size, m. Define: that of pack.h.
#include "common/pack.h"
#include "common/sizes.h"

// Whole a / n of results below 2^20: a division of integers takes several times as long.
static inline vint quotient(vint a, int n)
{
    const vint close = TO_INT(TO_FLOAT(a) * (1.0f / n)), left = a - close * n;
    return left < 0 ? close - 1 : left >= n ? close + 1 : close;
}

typedef struct { vint x, y, z; } voxel_place;

// Places along the axes of voxels whose flat indices these are.
static inline voxel_place place_of(int3 grid, vint voxel)
{
    const vint x = quotient(voxel, NY * NZ), left = voxel - x * (NY * NZ), y = quotient(left, NZ);
    return (voxel_place){x, y, left - y * NZ};
}

#if PACK == 1

static inline float3 voxel_centre(int3 grid, __global const float *geometry, int voxel)
{
    const voxel_place at = place_of(grid, voxel);
    return (float3)(geometry[0] + (at.x + 0.5f) * geometry[3], geometry[1] + (at.y + 0.5f) * geometry[3],
                    geometry[2] + (at.z + 0.5f) * geometry[3]);
}
#endif

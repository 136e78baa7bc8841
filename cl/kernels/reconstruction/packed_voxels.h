// Where packs of voxels are in a grid.
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

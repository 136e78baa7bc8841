// Where voxels are. geometry: the grid's origin (3) and the voxels' size, m.
#include "common/sizes.h"

static inline float3 voxel_centre(int3 grid, __global const float *geometry, int voxel)
{
    const uint slab = NY * NZ, row = NZ;
    const uint x = (uint)voxel / slab, left = (uint)voxel - x * slab, y = left / row;
    return (float3)(geometry[0] + (x + 0.5f) * geometry[3], geometry[1] + (y + 0.5f) * geometry[3],
                    geometry[2] + (left - y * row + 0.5f) * geometry[3]);
}

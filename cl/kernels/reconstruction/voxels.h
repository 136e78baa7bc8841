// Where voxels are. Defines: NY, NZ of the grid. geometry: its origin (3) and the voxels' size, m.
#if !defined(NY) || !defined(NZ)
#error "reconstruction/voxels.h needs NY and NZ"
#endif

static inline float3 voxel_centre(__global const float *geometry, int voxel)
{
    const int x = voxel / (NY * NZ), y = voxel / NZ % NY, z = voxel % NZ;
    return (float3)(geometry[0] + (x + 0.5f) * geometry[3], geometry[1] + (y + 0.5f) * geometry[3],
                    geometry[2] + (z + 0.5f) * geometry[3]);
}

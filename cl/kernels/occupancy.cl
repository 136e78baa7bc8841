// Voxel occupancy, Song et al. eq. (3)-(9), on the grid and one layer of voxels around it, which
// the smoothing needs. Defines: NX NY NZ of the padded grid, N_CAMERAS, WIDTH, HEIGHT of the
// evidence maps, MIN_CAMERAS; NO_DISTORTION if no camera has any.
//
// Work item 0 runs along z and the camera loop is unrolled: so a compiler for CPUs turns the loop
// over work items into vector code (branches are written as selections for the same reason).
#include "camera.h"

__kernel void occupancy(__global const float *restrict cameras,
                        __global const char *restrict evidence,
                        __global const float *restrict table, // P(V=1) by sum of evidence
                        __global const float *restrict geometry, // origin (3), voxel size
                        __global float *restrict probability)
{
    const int z = get_global_id(0), y = get_global_id(1), x = get_global_id(2);
    if (z >= NZ || y >= NY || x >= NX) return;
    // Centre of the voxel; the padding shifts the grid by one voxel.
    const float px = geometry[0] + (x - 0.5f) * geometry[3];
    const float py = geometry[1] + (y - 0.5f) * geometry[3];
    const float pz = geometry[2] + (z - 0.5f) * geometry[3];
    int sum = 0, seeing = 0;
#pragma unroll
    for (int k = 0; k < N_CAMERAS; ++k) {
        __global const float *camera = cameras + k * CAMERA_FLOATS;
        float2 pixel;
        camera_project(camera, px, py, pz, &pixel);
        const int at = camera_offset(camera, pixel, WIDTH);
        const int counts = evidence[k * (WIDTH * HEIGHT) + (at >= 0 ? at : 0)];
        sum += at >= 0 ? counts : 0;
        seeing += at >= 0;
    }
    const float seen = table[sum + 127 * N_CAMERAS];
    probability[(x * NY + y) * NZ + z] = seeing >= MIN_CAMERAS ? seen : 0.0f;
}

// Colours of the surface voxels from the pictures of the cameras that see them (Song et al. 3.3);
// twin: psfs/reference/surface.py. Define: TOLERANCE in voxels.
#if !defined(CAMERA_FLOATS) || !defined(TOLERANCE)
#error "reconstruction/colour.cl needs CAMERA_FLOATS and TOLERANCE"
#endif
#include "common/camera.h"
#include "reconstruction/voxels.h"


// Depth of the nearest voxel at every pixel: each covers its bounding box, as in reprojection.cl.
__kernel void nearest_depth(int2 picture, int3 grid, __global const float *restrict cameras,
                            __global const float2 *restrict extents,
                            __global const float *restrict geometry,
                            __global const int *restrict indices,
                            __global const int *restrict n_surface,
                            volatile __global uint *restrict depths)
{
    const int view = get_global_id(1), n = *n_surface;
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    volatile __global uint *map = depths + view * PIXELS;
    const int last_x = (int)camera[23] - 1, last_y = (int)camera[24] - 1;
    for (int i = get_global_id(0); i < n; i += get_global_size(0)) {
        const float3 centre = voxel_centre(grid, geometry, indices[i]);
        float2 pixel;
        const float depth = camera_project(camera, centre.x, centre.y, centre.z, &pixel);
        if (depth <= 0.0f) continue;
        const float2 half_size = extents[view] / depth;
        const float2 nearest = rint(pixel);
        // Beside a camera both lie beyond what an int holds.
        const float2 low = fmin(fmax(fmin(ceil(pixel - half_size), nearest), 0.0f),
                                (float2)(WIDTH, HEIGHT));
        const float2 high = fmin(fmax(floor(pixel + half_size), nearest),
                                 (float2)(last_x, last_y));
        const uint bits = as_uint(depth);
        for (int row = (int)low.y; row <= (int)high.y; ++row)
            for (int column = (int)low.x; column <= (int)high.x; ++column)
                // Looking first spares most of the atomics.
                if (map[row * WIDTH + column] > bits) atomic_min(map + row * WIDTH + column, bits);
    }
}

// Mean colour over the cameras that see a voxel as one of the nearest and hold its pixel for the
// person; over all that see it where none does; else the colour in the camera before which least
// stands in between. RGB, and the number of cameras in the mean.
__kernel void surface_colour(int2 picture, int3 grid, int n_views,
                             __global const float *restrict cameras,
                             __global const float *restrict geometry,
                             __global const int *restrict indices,
                             __global const int *restrict n_surface,
                             __global const uint *restrict depths,
                             __global const uchar *restrict images, // BGR
                             __global const char *restrict evidence,
                             __global uchar4 *restrict colours)
{
    const int n = *n_surface;
    for (int i = get_global_id(0); i < n; i += get_global_size(0)) {
        const float3 centre = voxel_centre(grid, geometry, indices[i]);
        int3 inner = (int3)(0), any = (int3)(0), least = (int3)(0);
        int n_inner = 0, n_any = 0;
        float least_depth = MAXFLOAT;
        for (int k = 0; k < n_views; ++k) {
            __global const float *camera = cameras + k * CAMERA_FLOATS;
            float2 pixel;
            const float depth = camera_project(camera, centre.x, centre.y, centre.z, &pixel);
            const int at = camera_offset(camera, pixel, WIDTH);
            if (at < 0) continue;
            const int p = k * PIXELS + at;
            const int3 rgb = (int3)(images[3 * p + 2], images[3 * p + 1], images[3 * p]);
            const float behind = depth - as_float(depths[p]);
            if (behind <= TOLERANCE * geometry[3]) {
                any += rgb;
                ++n_any;
                if (evidence[p] > 0) {
                    inner += rgb;
                    ++n_inner;
                }
            } else if (behind < least_depth) {
                least_depth = behind;
                least = rgb;
            }
        }
        const int number = n_inner > 0 ? n_inner : n_any;
        const int3 sum = n_inner > 0 ? inner : number > 0 ? any : least;
        const int shared = number > 0 ? number : 1;
        const int3 mean = (sum + shared / 2) / shared;
        colours[i] = (uchar4)(mean.x, mean.y, mean.z, number);
    }
}

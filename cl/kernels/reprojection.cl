// Projection of the surface voxels into every camera (Song et al. 2.3.2): silhouette and edge
// proximity. Defines: WIDTH HEIGHT of the stack of maps, RADIUS of the proximity in pixels, and
// for `splat` NY NZ of the grid. Two scratch stacks spare the distance passes their bounds
// checks: `far` has RADIUS rows of 255 above and below every view, `gap` RADIUS columns left and
// right of it.
#include "camera.h"

// Every voxel covers the bounding box of its projected cube: all pixel centres inside, or the
// nearest pixel if there is none. All writers write 255, so their order does not matter.
// `extents` holds, per view, half the width and height of the box times depth, px m.
__kernel void splat(__global const float *restrict cameras, __global const float2 *restrict extents,
                    __global const float *restrict geometry, // origin (3), voxel size
                    __global const int *restrict indices, __global const int *restrict n_surface,
                    __global uchar *restrict silhouette)
{
    const int view = get_global_id(1);
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    __global uchar *map = silhouette + (size_t)view * WIDTH * HEIGHT;
    const int last_x = (int)camera[23] - 1, last_y = (int)camera[24] - 1, n = *n_surface;
    for (int i = get_global_id(0); i < n; i += get_global_size(0)) {
        const int voxel = indices[i];
        const int x = voxel / (NY * NZ), y = voxel / NZ % NY, z = voxel % NZ;
        float2 pixel;
        const float depth = camera_project(camera, geometry[0] + (x + 0.5f) * geometry[3],
                                           geometry[1] + (y + 0.5f) * geometry[3],
                                           geometry[2] + (z + 0.5f) * geometry[3], &pixel);
        if (depth <= 0.0f) continue;
        const float2 half_size = extents[view] / depth;
        const float2 nearest = rint(pixel);
        const float2 low = fmax(fmin(ceil(pixel - half_size), nearest), 0.0f);
        const float2 high = fmin(fmax(floor(pixel + half_size), nearest),
                                 (float2)(last_x, last_y));
        for (int row = (int)low.y; row <= (int)high.y; ++row)
            for (int column = (int)low.x; column <= (int)high.x; ++column)
                map[row * WIDTH + column] = 255;
    }
}

// 0 on the silhouette's boundary (inside, with a 4-neighbour outside), 255 elsewhere. The border
// of the picture is no boundary: nothing is known beyond it.
__kernel void boundary(__global const uchar *restrict silhouette,
                       __global const int2 *restrict sizes, __global uchar *restrict far)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    __global const uchar *map = silhouette + (size_t)view * WIDTH * HEIGHT;
    const int here = y * WIDTH + x;
    const int width = sizes[view].x, height = sizes[view].y;
    const int inside = map[x > 0 ? here - 1 : here] & map[x < width - 1 ? here + 1 : here] &
                       map[y > 0 ? here - WIDTH : here] & map[y < height - 1 ? here + WIDTH : here];
    const int edge = (map[here] != 0) & (inside == 0);
    far[((size_t)view * (HEIGHT + 2 * RADIUS) + y + RADIUS) * WIDTH + x] = edge ? 0 : 255;
}

// Distance along the column to the nearest boundary pixel, RADIUS + 1 if there is none in reach.
__kernel void column_gap(__global const uchar *restrict far, __global uchar *restrict gap)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    __global const uchar *top = far + ((size_t)view * (HEIGHT + 2 * RADIUS) + y) * WIDTH + x;
    uchar nearest = RADIUS + 1;
#pragma unroll
    for (int dy = -RADIUS; dy <= RADIUS; ++dy)
    {
        const uchar edge = top[(dy + RADIUS) * WIDTH];
        const uchar reach = dy < 0 ? -dy : dy;
        const uchar here = edge > reach ? edge : reach;
        nearest = here < nearest ? here : nearest;
    }
    gap[((size_t)view * HEIGHT + y) * (WIDTH + 2 * RADIUS) + x + RADIUS] = nearest;
}

// Exact squared distance to the nearest boundary pixel, by `proximity` (up to RADIUS^2, then 0);
// the result is (silhouette, proximity) per pixel.
__kernel void edge_proximity(__global const uchar *restrict silhouette,
                             __global const uchar *restrict gap,
                             __global const uchar *restrict proximity,
                             __global uchar2 *restrict maps)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    __global const uchar *left = gap + ((size_t)view * HEIGHT + y) * (WIDTH + 2 * RADIUS) + x;
    ushort squared = RADIUS * RADIUS + 1;
#pragma unroll
    for (int dx = -RADIUS; dx <= RADIUS; ++dx) {
        const ushort g = left[dx + RADIUS];
        const ushort here = g * g + dx * dx;
        squared = here < squared ? here : squared;
    }
    const size_t at = (size_t)view * WIDTH * HEIGHT + y * WIDTH + x;
    maps[at] = (uchar2)(silhouette[at], proximity[squared]);
}

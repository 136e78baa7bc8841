// The location prior of the silhouettes by a tracked body (psfs/voxels/body_prior.py); twin: body_location in psfs/reference/body_prior.py. Cells are CELL x CELL pixels.
// Defines: CELL.
#if !defined(CELL)
#error "reconstruction/body_location.cl needs CELL"
#endif
#include "common/cones.h"
#include "reconstruction/cells.h"

// Log odds of foreground, counts, by the distance from the ray through a cell's middle to the body's
// cones. `centres` holds the cameras' centres, `rays` the directions (views, rows, columns), `body`
// the packed body of body_prior.h; of its first row [5] to [8] are the counts inside, the counts
// outside, the counts per metre between them, and those within parts near the floor, whose cone
// [15] is 1, else 0. Without cones the prior stays as it is.
__kernel void body_location(int2 picture, __global const float4 *restrict centres,
                            __global const float *restrict rays,
                            __global const float *restrict body, __global char *restrict location)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= CELLS_X || y >= CELLS_Y) return;
    const int cell = (view * CELLS_Y + y) * CELLS_X + x, n = (int)body[4];
    const float3 centre = centres[view].xyz, ray = vload3(cell, rays);
    float counts = body[6];
    for (int i = 1; i <= n; ++i) {
        const float16 cone = vload16(i, body);
        const float distance = ray_cone_distance(cone, centre, ray);
        counts = fmax(counts, -distance * (cone.sf > 0.0f && distance < 0.0f ? body[8] : body[7]));
    }
    if (n == 0) return;
    location[cell] = (char)rint(fmin(counts, body[5]));
}

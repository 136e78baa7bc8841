// The location prior of the silhouettes by a tracked body (psfs/voxels/body_prior.py); twin:
// body_location in psfs/reference/reconstructor.py. Cells are CELL x CELL pixels.
// A work-item has PACK neighbouring cells of a row; the last of a row begin earlier where its width is
// not a multiple. Defines: CELL, PACK.
#if !defined(CELL)
#error "reconstruction/body_location.cl needs CELL"
#endif
#include "common/pack.h"
#include "reconstruction/cells.h"

static inline float dot_of(float3 a, float3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static inline vfloat along(float3 way, vpoint ray) { return way.x * ray.x + (way.y * ray.y + way.z * ray.z); }

// Signed distance from the lines through `from` along `rays` to the surface of a cone, see
// common/cones.h, negative inside; the ends are rounded.
static inline vfloat ray_distance(float16 cone, float3 from, vpoint rays)
{
    const float3 offset = from - cone.s012, axis = cone.s456 - cone.s012;
    const float length = sqrt(dot_of(axis, axis));
    const float px = dot_of(offset, cone.s89a), py = dot_of(offset, cone.scde);
    const float pz = dot_of(offset, axis) / length;
    const vpoint d = {along(cone.s89a, rays), along(cone.scde, rays), along(axis, rays) / length};
    const vfloat nearest = -(px * d.x + py * d.y) / most(d.x * d.x + d.y * d.y, 1e-12f);
    const vfloat t = within((pz + nearest * d.z) / length, 0.0f, 1.0f), z = pz - t * length;
    const vfloat back = (px * d.x + py * d.y + z * d.z) / inner(d, d);
    const vpoint left = {px - back * d.x, py - back * d.y, z - back * d.z};
    return sqrt(inner(left, left)) - (cone.s3 + t * (cone.s7 - cone.s3));
}

// Log odds of foreground, counts, by the distance from the ray through a cell's middle to the body's
// cones. `centres` holds the cameras' centres, `rays` planes of x, y and z of the directions (views, 3,
// rows, columns), NaN where a lens shows nothing, `body` the packed body of body_prior.h; of its first
// row [5] to [8] are the counts inside, the counts outside, the counts per metre between them, and
// those within parts near the floor, whose cone [15] is 1, else 0. Without cones the prior stays as it
// is.
__kernel void body_location(int2 picture, __global const float4 *restrict centres,
                            __global const float *restrict rays,
                            __global const float *restrict body, __global char *restrict location)
{
    const int begin = get_global_id(0) * PACK, y = get_global_id(1), view = get_global_id(2);
    const int n = (int)body[4], plane = CELLS_X * CELLS_Y;
    if (begin >= CELLS_X || y >= CELLS_Y || n == 0) return;
    const int cell = y * CELLS_X + (begin < CELLS_X - PACK ? begin : CELLS_X - PACK);
    __global const float *own = rays + 3 * view * plane + cell;
    const vpoint ray = {LOAD_PACK(own), LOAD_PACK(own + plane), LOAD_PACK(own + 2 * plane)};
    vfloat counts = body[6];
    for (int i = 1; i <= n; ++i) {
        const float16 cone = vload16(i, body);
        const vfloat distance = ray_distance(cone, centres[view].xyz, ray);
        const vfloat steep = cone.sf > 0.0f ? body[8] : body[7], usual = body[7];
        const vfloat found = -distance * (distance < 0.0f ? steep : usual);
        counts = found > counts ? found : counts;
    }
    STORE_PACK(TO_CHAR(rint(least(counts, body[5]))), location + view * plane + cell);
}

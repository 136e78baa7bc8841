// The synthetic scene: a person (smooth union of squashed round cones, sphere traced) in a
// textured room. The twin of the person's silhouette and depth is apf/reference/synthetic/scene.py.
//
// Defines: those of scene_person.h and scene_room.h; BALLS; SHADOW_SIZE (texels), SHADOW_STEP (m
// per texel); TILE (px).
#if !defined(BALLS) || !defined(CAMERA_FLOATS) || !defined(PRIMITIVES) || \
    !defined(SHADOW_SIZE) || !defined(SHADOW_STEP) || !defined(TILE)
#error "synthetic/scene.cl needs BALLS, CAMERA_FLOATS, PRIMITIVES, SHADOW_SIZE, SHADOW_STEP and TILE"
#endif
#include "common/camera.h"
#include "common/sizes.h"
#include "synthetic/scene_person.h"
#include "synthetic/scene_room.h"

#define TILES_X ((WIDTH + TILE - 1) / TILE)
#define TILES_Y ((HEIGHT + TILE - 1) / TILE)

// Unit ray of `pixel` in the world; *depth_per_length turns lengths along it into depths. The
// distortion is inverted by fixed-point iteration, as cv2.undistortPoints does.
INLINED float3 camera_ray(__global const float *camera, float2 pixel, float *depth_per_length)
{
    const float yd = (pixel.y - camera[15]) / camera[13];
    const float xd = (pixel.x - camera[14] - camera[16] * yd) / camera[12];
    const float k1 = camera[17], k2 = camera[18], p1 = camera[19], p2 = camera[20];
    float x = xd, y = yd;
    for (int i = 0; i < 10; ++i) {
        const float r2 = x * x + y * y;
        const float radial = 1.0f + r2 * (k1 + r2 * (k2 + r2 * camera[21]));
        const float tx = 2.0f * p1 * x * y + p2 * (r2 + 2.0f * x * x);
        const float ty = p1 * (r2 + 2.0f * y * y) + 2.0f * p2 * x * y;
        x = (xd - tx) / radial;
        y = (yd - ty) / radial;
    }
    const float scale = 1.0f / sqrt(x * x + y * y + 1.0f);
    *depth_per_length = scale;
    return scale * (float3)(camera[0] * x + camera[3] * y + camera[6],
                            camera[1] * x + camera[4] * y + camera[7],
                            camera[2] * x + camera[5] * y + camera[8]);
}

INLINED float3 camera_centre(__global const float *camera)
{
    return (float3)(camera[25], camera[26], camera[27]);
}

// tiles (V, TILES_Y, TILES_X, PRIMITIVES + 1): number, then indices of the primitives that some ray
// of the tile may meet. Wherever a primitive is, the tile's rays stray from its middle ray by at
// most tan(angle) times the distance.
__kernel void bin_primitives(int2 picture, __global const float *cameras, __global const float *primitives,
                             __global uchar *tiles)
{
    const int i = get_global_id(0), j = get_global_id(1), view = get_global_id(2);
    if (i >= TILES_X || j >= TILES_Y) return;
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    __global uchar *tile = tiles + ((view * TILES_Y + j) * TILES_X + i) * (PRIMITIVES + 1);
    const float3 origin = camera_centre(camera);
    const float2 corner = (float2)(TILE * i - 1.0f, TILE * j - 1.0f);
    const float size = TILE + 1.0f;
    float per_length;
    const float3 ray = camera_ray(camera, corner + 0.5f * size, &per_length);
    float cosine = 1.0f;
    for (int k = 0; k < 4; ++k) {
        const float2 pixel = corner + size * (float2)(k & 1, k >> 1);
        cosine = fmin(cosine, dot(ray, camera_ray(camera, pixel, &per_length)));
    }
    const float spread = 1.05f * sqrt(fmax(1.0f - cosine * cosine, 0.0f)) / fmax(cosine, 0.1f);
    int count = 0;
    for (int k = 0; k < PRIMITIVES; ++k) {
        __global const float *g = primitives + k * PRIMITIVE_FLOATS;
        const float3 to = (float3)(g[20], g[21], g[22]) - origin;
        const float slack = spread * (sqrt(dot(to, to)) + g[23] + MAX_BLEND);
        float middle, chord;
        if (near_line(g, origin, ray, slack, &middle, &chord)) tile[++count] = (uchar)k;
    }
    tile[0] = (uchar)count;
}

// colours (V, H, W, 3) float: the empty room, 2 x 2 rays per pixel; distance (V, H, W): of
// the last of them; floor_point (V, H, W, 2): their mean point on the floor, FAR where it is none.
__kernel void empty_room(int2 picture, __global const float *cameras, __global const float *posters,
                         __global const float *boxes, const int seed, __global float *colours,
                         __global float *distance, __global float *floor_point)
{
    const int u = get_global_id(0), v = get_global_id(1), view = get_global_id(2);
    if (u >= WIDTH || v >= HEIGHT) return;
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    const float3 origin = camera_centre(camera);
    const int id = (view * HEIGHT + v) * WIDTH + u;
    float3 sum = (float3)(0.0f);
    float2 floor_sum = (float2)(0.0f);
    float t;
    for (int k = 0; k < 4; ++k) {
        const float2 pixel = (float2)(u + 0.5f * (k & 1) - 0.25f, v + 0.5f * (k >> 1) - 0.25f);
        float per_length;
        int on_floor;
        const float3 ray = camera_ray(camera, pixel, &per_length);
        sum += room_colour(posters, boxes, origin, ray, seed, &t, &on_floor);
        const float2 place = (float2)(origin.x + t * ray.x, origin.y + t * ray.y);
        floor_sum += on_floor ? place : (float2)(FAR);
    }
    distance[id] = t;
    vstore2(0.25f * floor_sum, id, floor_point);
    vstore3(0.25f * sum, id, colours);
}

// shadow (SHADOW_SIZE, SHADOW_SIZE): by how much the body (as spheres) darkens the floor, grey
// level factor, around `centre`, times `strength`. Ambient part: a sphere hides r^2 h / d^3 of the sky; direct part:
// penumbra of a lamp of radius LAMP_RADIUS.
__kernel void floor_shadow(__global const float *balls, const float2 centre,
                           const float strength, __global float *shadow)
{
    const int i = get_global_id(0), j = get_global_id(1);
    if (i >= SHADOW_SIZE || j >= SHADOW_SIZE) return;
    const float half_size = 0.5f * (SHADOW_SIZE - 1);
    const float3 p = (float3)(centre.x + SHADOW_STEP * ((float)i - half_size),
                              centre.y + SHADOW_STEP * ((float)j - half_size), 0.0f);
    float3 to[2];
    float lamp_distance[2], light[2], seen[2] = {1.0f, 1.0f};
    for (int k = 0; k < 2; ++k) {
        to[k] = (float3)(LAMPS[4 * k], LAMPS[4 * k + 1], LAMPS[4 * k + 2]) - p;
        lamp_distance[k] = sqrt(dot(to[k], to[k]));
        to[k] /= lamp_distance[k];
        const float away = lamp_distance[k] * lamp_distance[k] + 8.0f;
        light[k] = LAMPS[4 * k + 3] * to[k].z * 26.0f / away;
    }
    float covered = 0.0f;
    for (int b = 0; b < BALLS; ++b) {
        const float3 c = (float3)(balls[4 * b], balls[4 * b + 1], balls[4 * b + 2]) - p;
        const float radius = balls[4 * b + 3];
        const float d2 = fmax(dot(c, c), radius * radius);
        covered += 0.45f * radius * radius * fmax(c.z, 0.0f) * rsqrt(d2) / d2;
        for (int k = 0; k < 2; ++k) {
            const float at = dot(c, to[k]);
            if (at <= 0.0f) continue;
            const float off = sqrt(fmax(dot(c, c) - at * at, 0.0f)) - radius;
            const float blur = 0.012f + LAMP_RADIUS * at / lamp_distance[k];
            seen[k] = fmin(seen[k], smoothstep(-blur, blur, off));
        }
    }
    const float open = exp(-covered);
    const float ambient = 0.80f;
    const float full = ambient + light[0] + light[1];
    const float rim = fmax(fabs((float)i - half_size), fabs((float)j - half_size)) / half_size;
    const float factor = (ambient * open + light[0] * seen[0] + light[1] * seen[1]) / full;
    const float full_shadow = mix(sqrt(factor), 1.0f, smoothstep(0.85f, 0.99f, rim));
    shadow[j * SHADOW_SIZE + i] =
        strength < 1.0f ? mix(1.0f, full_shadow, strength) : full_shadow;
}

// The room's pixel under the person's shadow: bilinear look-up of the shadow map.
INLINED float3 shadowed_room(__global const float *room, __global const float *floor_point,
                             __global const float *shadow, const float2 centre, int id)
{
    const float3 colour = vload3(id, room);
    const float half_size = 0.5f * (SHADOW_SIZE - 1);
    const float x = (floor_point[2 * id] - centre.x) / SHADOW_STEP + half_size;
    const float y = (floor_point[2 * id + 1] - centre.y) / SHADOW_STEP + half_size;
    if (!(x >= 0.0f && y >= 0.0f && x < SHADOW_SIZE - 1 && y < SHADOW_SIZE - 1)) return colour;
    const int i = (int)x, j = (int)y;
    __global const float *s = shadow + j * SHADOW_SIZE + i;
    const float near = mix(s[0], s[1], x - i), far = mix(s[SHADOW_SIZE], s[SHADOW_SIZE + 1], x - i);
    return colour * mix(near, far, y - j);
}

static inline __global const uchar *tile_of(int2 picture, __global const uchar *tiles, int u, int v, int view)
{
    return tiles + ((view * TILES_Y + v / TILE) * TILES_X + u / TILE) * (PRIMITIVES + 1);
}

// colours (V, H, W, 3) float grey levels, mask (V, H, W) 0/255 and depth (V, H, W) m (0 = no
// person) from the rays through pixel centres.
__kernel void render(int2 picture, __global const float *cameras, __global const float *primitives,
                     __global const uchar *tiles, __global const float *palette,
                     __global const float *room, __global const float *distance,
                     __global const float *floor_point, __global const float *shadow,
                     const float2 centre, __global float *colours, __global uchar *mask,
                     __global float *depth)
{
    const int u = get_global_id(0), v = get_global_id(1), view = get_global_id(2);
    if (u >= WIDTH || v >= HEIGHT) return;
    const int id = (view * HEIGHT + v) * WIDTH + u;
    __global const uchar *tile = tile_of(picture, tiles, u, v, view);
    float t = 0.0f, per_length = 0.0f;
    float3 colour;
    if (tile[0]) {
        __global const float *camera = cameras + view * CAMERA_FLOATS;
        const float3 origin = camera_centre(camera);
        const float3 ray = camera_ray(camera, (float2)(u, v), &per_length);
        uchar list[PRIMITIVES];
        int count;
        t = trace(primitives, tile, origin, ray, distance[id], list, &count);
        if (t > 0.0f) colour = shade_body(primitives, list, count, palette, origin + t * ray);
    }
    if (t <= 0.0f) colour = shadowed_room(room, floor_point, shadow, centre, id);
    vstore3(colour, id, colours);
    mask[id] = t > 0.0f ? 255 : 0;
    depth[id] = t * per_length;
}

// Smooth the silhouette: pixels whose neighbour is on its other side are covered by as much of the
// person as 2 x 2 rays meet.
__kernel void smooth_edges(int2 picture, __global const float *cameras, __global const float *primitives,
                           __global const uchar *tiles, __global const float *palette,
                           __global const float *room, __global const float *distance,
                           __global const float *floor_point, __global const float *shadow,
                           const float2 centre, __global const uchar *mask,
                           __global float *colours)
{
    const int u = get_global_id(0), v = get_global_id(1), view = get_global_id(2);
    if (u >= WIDTH || v >= HEIGHT) return;
    const int id = (view * HEIGHT + v) * WIDTH + u;
    const uchar here = mask[id];
    if (mask[id - (u > 0)] == here && mask[id + (u < WIDTH - 1)] == here &&
        mask[id - (v > 0) * WIDTH] == here && mask[id + (v < HEIGHT - 1) * WIDTH] == here)
        return;
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    const float3 origin = camera_centre(camera);
    const float3 behind = shadowed_room(room, floor_point, shadow, centre, id);
    float3 person = vload3(id, colours);
    int hits = 0;
    for (int k = 0; k < 4; ++k) {
        const float2 pixel = (float2)(u + 0.5f * (k & 1) - 0.25f, v + 0.5f * (k >> 1) - 0.25f);
        float per_length;
        const float3 ray = camera_ray(camera, pixel, &per_length);
        uchar list[PRIMITIVES];
        int count;
        const float t = trace(primitives, tile_of(picture, tiles, u, v, view), origin, ray, distance[id],
                              list, &count);
        if (t <= 0.0f) continue;
        if (!here && !hits) // the pixel's own ray missed: this one's colour serves
            person = shade_body(primitives, list, count, palette, origin + t * ray);
        ++hits;
    }
    vstore3(mix(behind, person, 0.25f * hits), id, colours);
}

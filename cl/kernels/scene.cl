// The synthetic scene: a person (smooth union of squashed round cones, sphere traced) in a
// textured room. The twin of the person's silhouette and depth is apf/reference/scene.py.
//
// Compiled with -D PRIMITIVES, ROOM_X, ROOM_Y, ROOM_Z (half width, half depth, height, m),
// POSTERS, BOXES, BALLS, SHADOW_SIZE (texels), SHADOW_STEP (m per texel), WIDTH,
// HEIGHT, VIEWS, TILE (pixels), TILES_X, TILES_Y.
//
// A primitive is PRIMITIVE_FLOATS floats:
//   0-11 world -> its frame (3x3 row-major and offset; across axes divided by the squash)
//   12 length  13 radius at 0  14 taper m  15 m / sqrt(1 - m^2)  16-17 1 / squash  18 blend
//   19 group  20-23 bounding sphere  24 region  25 region beyond  26 split  27 rest height at 0
//   28 rest height per length  31 largest radius
#include "camera.h"

#define PRIMITIVE_FLOATS 32
#define MAX_BLEND 0.07f
#define MARCH_STEPS 64
#define HIT 5e-4f
#define FAR 1e6f

// Where the two lamps hang and how strong they are (display-linear units).
__constant float LAMPS[8] = {1.6f, -1.9f, 4.6f, 0.56f, -2.1f, 1.4f, 4.3f, 0.36f};
#define LAMP_RADIUS 0.32f

// Rays -------------------------------------------------------------------------------------------

// Unit ray of `pixel` in the world; *depth_per_length turns lengths along it into depths. The
// distortion is inverted by fixed-point iteration, as cv2.undistortPoints does.
inline float3 camera_ray(__global const float *camera, float2 pixel, float *depth_per_length)
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

inline float3 camera_centre(__global const float *camera)
{
    return (float3)(camera[25], camera[26], camera[27]);
}

// Noise ------------------------------------------------------------------------------------------

inline float hash(int x, int y, int z)
{
    uint h = (uint)x * 0x8da6b343u ^ (uint)y * 0xd8163841u ^ (uint)z * 0xcb1ab31fu;
    h = (h ^ (h >> 15)) * 0x2c1b3c6du;
    h = (h ^ (h >> 12)) * 0x297a2d39u;
    return (float)((h ^ (h >> 15)) & 0xffffffu) / 16777216.0f;
}

// Smooth noise in [0, 1] with unit cells.
inline float value_noise(float x, float y, int seed)
{
    const float fx = floor(x), fy = floor(y);
    const int ix = (int)fx, iy = (int)fy;
    float u = x - fx, v = y - fy;
    u = u * u * (3.0f - 2.0f * u);
    v = v * v * (3.0f - 2.0f * v);
    return mix(mix(hash(ix, iy, seed), hash(ix + 1, iy, seed), u),
               mix(hash(ix, iy + 1, seed), hash(ix + 1, iy + 1, seed), u), v);
}

inline float fractal_noise(float x, float y, int seed)
{
    return 0.55f * value_noise(x, y, seed) + 0.30f * value_noise(2.1f * x, 2.1f * y, seed + 1) +
           0.15f * value_noise(4.3f * x, 4.3f * y, seed + 2);
}

// A saturated colour from a hue in [0, 1), linear BGR.
inline float3 hue_colour(float hue, float saturation, float value)
{
    const float3 k = fabs(fmod((float3)(hue * 6.0f + 2.0f, hue * 6.0f + 4.0f, hue * 6.0f),
                               (float3)(6.0f)) - 3.0f) - 1.0f;
    return value * mix((float3)(1.0f), clamp(k, 0.0f, 1.0f), saturation);
}

// The person's signed distance -------------------------------------------------------------------

// First-order distance (m) to one primitive; *along is the position on its axis.
inline float primitive_distance(__global const float *g, float3 p, float *along)
{
    const float x = g[0] * p.x + g[1] * p.y + g[2] * p.z + g[9];
    const float y = g[3] * p.x + g[4] * p.y + g[5] * p.z + g[10];
    const float z = g[6] * p.x + g[7] * p.y + g[8] * p.z + g[11];
    const float rho2 = x * x + y * y;
    const float nearest = clamp(z + g[15] * sqrt(rho2), 0.0f, g[12]);
    const float vz = z - nearest;
    const float length = sqrt(rho2 + vz * vz);
    const float sx = x * g[16], sy = y * g[17];
    const float slope = sqrt(sx * sx + sy * sy + vz * vz);
    *along = z;
    const float squash = slope > 1e-6f ? length / slope : 1.0f;
    return (length - (g[13] + g[14] * nearest)) * squash;
}

// Polynomial smooth minimum: differs from min only where |a - b| < k.
inline float smooth_min(float a, float b, float k)
{
    const float h = fmax(k - fabs(a - b), 0.0f) / k;
    return fmin(a, b) - 0.25f * h * h * k;
}

// Distance to the listed primitives (in the order of their groups).
inline float body_distance(__global const float *primitives, const uchar *list, int count,
                           float3 p)
{
    float total = FAR, part = FAR, group = -1.0f, along;
    for (int i = 0; i < count; ++i) {
        __global const float *g = primitives + list[i] * PRIMITIVE_FLOATS;
        if (g[19] != group) {
            total = fmin(total, part);
            part = FAR;
            group = g[19];
        }
        part = smooth_min(part, primitive_distance(g, p, &along), g[18]);
    }
    return fmin(total, part);
}

// Whether primitive `g` comes within MAX_BLEND + slack of the line from `origin` along `ray`;
// *middle +- *chord: the piece of the line in its bounding sphere.
inline bool near_line(__global const float *g, float3 origin, float3 ray, float slack,
                      float *middle, float *chord)
{
    const float3 to = (float3)(g[20], g[21], g[22]) - origin;
    const float radius = g[23] + MAX_BLEND + slack;
    *middle = dot(to, ray);
    const float off2 = dot(to, to) - *middle * *middle;
    if (off2 > radius * radius || *middle <= -radius) return false;
    *chord = sqrt(radius * radius - off2);
    // Then the capsule: distance between the line and the primitive's axis.
    const float3 axis = (float3)(g[6], g[7], g[8]);
    const float b = dot(axis, ray), s = dot(axis, to), half_length = 0.5f * g[12];
    const float t = clamp((b * *middle - s) / fmax(1.0f - b * b, 1e-6f), -half_length, half_length);
    const float3 nearest = to + t * axis;
    const float at = dot(nearest, ray), reach = g[31] + MAX_BLEND + slack;
    return dot(nearest, nearest) - at * at <= reach * reach;
}

// Those primitives of the tile that the ray passes within MAX_BLEND; [*enter, *leave] spans them.
inline int primitives_on_ray(__global const float *primitives, __global const uchar *tile,
                             float3 origin, float3 ray, uchar *list, float *enter, float *leave)
{
    int count = 0;
    *enter = FAR;
    *leave = 0.0f;
    for (int i = 1; i <= tile[0]; ++i) {
        float middle, chord;
        if (!near_line(primitives + tile[i] * PRIMITIVE_FLOATS, origin, ray, 0.0f, &middle, &chord))
            continue;
        list[count++] = tile[i];
        *enter = fmin(*enter, middle - chord);
        *leave = fmax(*leave, middle + chord);
    }
    *enter = fmax(*enter, 0.0f);
    return count;
}

// Length along the ray to the body, or 0 where it is missed or farther than `limit`; the
// primitives it concerns are left in list[0..*count).
inline float trace(__global const float *primitives, __global const uchar *tile, float3 origin,
                   float3 ray, float limit, uchar *list, int *count)
{
    float t, leave;
    *count = primitives_on_ray(primitives, tile, origin, ray, list, &t, &leave);
    leave = fmin(leave, limit);
    for (int i = 0; i < MARCH_STEPS && t < leave; ++i) {
        const float d = body_distance(primitives, list, *count, origin + t * ray);
        if (d < HIT) return t;
        t += fmax(0.9f * d, 0.5f * HIT);
    }
    return 0.0f;
}

// Light ------------------------------------------------------------------------------------------

// Light from both lamps and the room's own brightness; `open` dims the latter.
inline float lighting(float3 p, float3 n, float open)
{
    // Bounced light comes from all sides, more from above.
    float light = open * (0.58f + 0.22f * n.z);
    for (int i = 0; i < 2; ++i) {
        const float3 to = (float3)(LAMPS[4 * i], LAMPS[4 * i + 1], LAMPS[4 * i + 2]) - p;
        const float d2 = dot(to, to);
        const float facing = dot(n, to) * rsqrt(d2);
        light += LAMPS[4 * i + 3] * fmax(facing, 0.0f) * 26.0f / (d2 + 8.0f);
    }
    return light;
}

// Linear light to grey levels 0..255, with a soft shoulder.
inline float3 display(float3 linear)
{
    const float3 c = linear / (1.0f + 0.18f * linear);
    return 255.0f * sqrt(clamp(c, 0.0f, 1.0f));
}

// The person's look ------------------------------------------------------------------------------

// Linear colour of a point of the nearest primitive `g`, `along` its axis; palette: 3 per region,
// then the shirt's second colour.
inline float3 cloth_colour(__global const float *palette, __global const float *g, float along,
                           float3 p)
{
    const int region = (int)(along > g[26] ? g[25] : g[24]);
    float3 colour = vload3(region, palette);
    const float height = g[27] + g[28] * along; // above the hips, at rest
    const float turn = atan2(g[3] * p.x + g[4] * p.y + g[5] * p.z + g[10],
                             g[0] * p.x + g[1] * p.y + g[2] * p.z + g[9]);
    const float weave = fractal_noise(height * 45.0f, turn * 7.0f, region * 11);
    if (region == 0) { // shirt: stripes
        const float at = height / 0.075f;
        const float stripe = smoothstep(0.56f, 0.62f, at - floor(at)) *
                             (1.0f - smoothstep(0.94f, 1.0f, at - floor(at)));
        colour = mix(colour, vload3(8, palette), stripe);
        colour *= 0.86f + 0.28f * weave;
    } else if (region == 1) { // trousers: washed cloth, a belt
        colour *= 0.70f + 0.60f * fractal_noise(height * 9.0f, turn * 2.0f, 5) *
                              (0.8f + 0.4f * weave);
    } else if (region == 3) { // hair: strands
        colour *= 0.6f + 0.8f * value_noise(turn * 20.0f, height * 6.0f, 3);
    } else if (region == 4) { // shoes: light soles
        colour *= 0.85f + 0.3f * weave;
        if (p.z < 0.018f) colour = vload3(6, palette);
    } else {
        colour *= 0.93f + 0.14f * weave;
    }
    return colour;
}

inline float3 body_normal(__global const float *primitives, const uchar *list, int count, float3 p)
{
    const float e = 1.5e-3f;
    const float3 a = (float3)(e, -e, -e), b = (float3)(-e, -e, e), c = (float3)(-e, e, -e);
    const float3 d = (float3)(e, e, e);
    return normalize(a * body_distance(primitives, list, count, p + a) +
                     b * body_distance(primitives, list, count, p + b) +
                     c * body_distance(primitives, list, count, p + c) +
                     d * body_distance(primitives, list, count, p + d));
}

inline float3 shade_body(__global const float *primitives, const uchar *list, int count,
                         __global const float *palette, float3 p)
{
    const float3 n = body_normal(primitives, list, count, p);
    float open = 1.0f;
    for (int i = 1; i <= 2; ++i) {
        const float reach = 0.035f * (float)i;
        const float d = body_distance(primitives, list, count, p + reach * n);
        open -= 0.40f * fmax(reach - d, 0.0f) / reach;
    }
    open *= 0.65f + 0.35f * smoothstep(0.0f, 0.9f, p.z); // the floor takes light from below
    float best = FAR, along = 0.0f, at;
    int nearest = 0;
    for (int i = 0; i < count; ++i) {
        const float d = primitive_distance(primitives + list[i] * PRIMITIVE_FLOATS, p, &at);
        if (d < best) {
            best = d;
            along = at;
            nearest = list[i];
        }
    }
    const float3 colour =
        cloth_colour(palette, primitives + nearest * PRIMITIVE_FLOATS, along, p);
    return display(colour * lighting(p, n, open));
}

// The room ---------------------------------------------------------------------------------------

inline float3 floor_colour(float x, float y, int seed)
{
    // A rug, turned a little, with a border and a woven pattern.
    const float rx = 0.94f * x + 0.34f * y - 0.35f, ry = -0.34f * x + 0.94f * y + 0.25f;
    const float edge = fmax(fabs(rx) - 1.25f, fabs(ry) - 0.85f);
    if (edge < 0.0f) {
        const float wool = 0.75f + 0.5f * fractal_noise(rx * 60.0f, ry * 60.0f, seed);
        const float diamonds = fabs(fmod(fabs(rx) * 2.6f, 1.0f) - 0.5f) +
                               fabs(fmod(fabs(ry) * 2.6f, 1.0f) - 0.5f);
        const float3 red = (float3)(0.075f, 0.065f, 0.26f), sand = (float3)(0.26f, 0.36f, 0.44f);
        const float3 blue = (float3)(0.22f, 0.11f, 0.06f);
        float3 colour = diamonds < 0.32f ? sand : diamonds < 0.52f ? blue : red;
        if (edge > -0.14f) colour = edge > -0.05f || edge < -0.11f ? sand : blue;
        return colour * wool;
    }
    // Oak planks along x, every row shifted.
    const float row = floor(y / 0.16f);
    const float shifted = x / 1.7f + hash((int)row, 3, seed);
    const float column = floor(shifted);
    const float shade = hash((int)row, (int)column, seed + 1);
    const float grain = fractal_noise(x * 3.0f + 17.0f * shade, y * 55.0f, seed + 2);
    const float v = y / 0.16f - row, u = shifted - column;
    const float gap = fmin(fmin(v, 1.0f - v) * 0.16f, fmin(u, 1.0f - u) * 1.7f);
    const float3 oak = mix((float3)(0.075f, 0.16f, 0.29f), (float3)(0.15f, 0.27f, 0.43f), shade);
    return oak * (0.62f + 0.62f * grain) * (gap < 0.003f ? 0.35f : 1.0f);
}

// A picture in a frame: u, v in [-1, 1], edge = distance to the frame's rim, m.
inline float3 poster_colour(float u, float v, float edge, float style, float hue, int seed)
{
    if (edge < 0.035f)
        return hue < 0.5f ? (float3)(0.03f, 0.03f, 0.035f) : (float3)(0.18f, 0.28f, 0.4f);
    if (edge < 0.075f) return (float3)(0.72f, 0.76f, 0.78f);
    const float3 one = hue_colour(hue, 0.65f, 0.55f);
    const float3 two = hue_colour(fmod(hue + 0.45f, 1.0f), 0.5f, 0.30f);
    const float n = fractal_noise(3.0f * u + 7.0f, 3.0f * v, seed);
    if (style < 1.0f) // hills under a sky
        return v < 0.9f * n - 0.45f ? two * (0.5f + n)
                                    : mix(one, (float3)(0.7f), 0.3f * (v + 1.0f));
    if (style < 2.0f) { // discs
        const float r = sqrt(u * u + v * v);
        return fmod(r * 3.2f, 1.0f) < 0.5f ? one : two;
    }
    if (style < 3.0f) { // print
        const bool ink = fmod(fabs(v) * 9.0f, 1.0f) < 0.55f &&
                         hash((int)(u * 18.0f), (int)(v * 9.0f), seed) > 0.3f;
        return v > 0.35f ? one * (0.6f + 0.8f * n)
                   : ink ? (float3)(0.05f) : (float3)(0.6f, 0.64f, 0.66f);
    }
    return mix(one, two, smoothstep(0.35f, 0.6f, n)); // abstract
}

inline float3 wall_colour(int wall, float along, float z, __global const float *posters, int seed)
{
    for (int i = 0; i < POSTERS; ++i) {
        __global const float *q = posters + 8 * i;
        if ((int)q[0] != wall) continue;
        const float u = along - q[1], v = z - q[2];
        const float edge = fmin(q[3] - fabs(u), q[4] - fabs(v));
        if (edge > 0.0f) return poster_colour(u / q[3], v / q[4], edge, q[5], q[6], seed + i);
    }
    if (z < 0.11f) return (float3)(0.55f, 0.58f, 0.60f); // baseboard
    const float plaster = 0.90f + 0.20f * fractal_noise(along * 7.0f, z * 7.0f, seed + wall);
    const float3 paint = (wall & 1) ? (float3)(0.46f, 0.50f, 0.48f) : (float3)(0.40f, 0.50f, 0.54f);
    return paint * plaster;
}

inline float3 box_colour(__global const float *box, float3 p, float3 n, int seed)
{
    const float3 low = vload3(0, box), high = (float3)(box[3], box[4], box[5]);
    const float across = fabs(n.x) > 0.5f ? p.y : p.x;
    const float up = fabs(n.z) > 0.5f ? p.y : p.z;
    const float hue = box[7];
    const float grain = fractal_noise(across * 4.0f, up * 40.0f, seed);
    const float3 from = fmin(p - low, high - p);
    const float edge = fabs(n.x) > 0.5f ? fmin(from.y, from.z)
                     : fabs(n.y) > 0.5f ? fmin(from.x, from.z) : fmin(from.x, from.y);
    if (box[6] < 1.0f) // wood
        return mix((float3)(0.06f, 0.13f, 0.24f), (float3)(0.12f, 0.22f, 0.34f), grain) *
               (edge < 0.02f ? 0.75f : 1.0f);
    if (box[6] < 2.0f) { // cardboard with tape
        const float middle = across - 0.5f * (fabs(n.x) > 0.5f ? low.y + high.y : low.x + high.x);
        const float3 tape = (float3)(0.33f, 0.45f, 0.55f), board = (float3)(0.16f, 0.27f, 0.40f);
        return (fabs(middle) < 0.03f ? tape : board) * (0.85f + 0.3f * grain);
    }
    if (box[6] < 3.0f) { // shelves full of books
        if (edge < 0.03f || fabs(n.z) > 0.5f) return (float3)(0.10f, 0.18f, 0.27f);
        const float shelf = floor((p.z - low.z) / 0.34f), rest = (p.z - low.z) - shelf * 0.34f;
        if (rest < 0.025f) return (float3)(0.10f, 0.18f, 0.27f);
        const float book = floor(across / 0.045f), h = hash((int)book, (int)shelf, seed);
        if (rest > 0.20f + 0.1f * h) return (float3)(0.02f, 0.02f, 0.025f);
        const float spine = across / 0.045f - book;
        return hue_colour(h * 7.3f - floor(h * 7.3f), 0.6f, 0.08f + 0.35f * h) *
               (spine < 0.12f ? 0.4f : 1.0f);
    }
    // cloth
    return hue_colour(hue, 0.45f, 0.25f) *
           (0.75f + 0.5f * fractal_noise(across * 50.0f, up * 50.0f, seed));
}

// Nearest box on the ray before *t: index or -1; *n its normal.
inline int hit_boxes(__global const float *boxes, float3 origin, float3 ray, float *t, float3 *n)
{
    int hit = -1;
    for (int i = 0; i < BOXES; ++i) {
        const float3 low = (vload3(0, boxes + 8 * i) - origin) / ray;
        const float3 high =
            ((float3)(boxes[8 * i + 3], boxes[8 * i + 4], boxes[8 * i + 5]) - origin) / ray;
        const float3 first = fmin(low, high), last = fmax(low, high);
        const float enter = fmax(fmax(first.x, first.y), first.z);
        if (enter > fmin(fmin(last.x, last.y), last.z) || enter <= 0.0f || enter >= *t) continue;
        *t = enter;
        hit = i;
        *n = enter == first.x ? (float3)(-sign(ray.x), 0.0f, 0.0f)
           : enter == first.y ? (float3)(0.0f, -sign(ray.y), 0.0f)
                              : (float3)(0.0f, 0.0f, -sign(ray.z));
    }
    return hit;
}

// How open the floor point is between the walls and the boxes that stand on it.
inline float floor_openness(__global const float *boxes, float x, float y)
{
    float open = 1.0f - 0.30f * exp(-4.0f * (ROOM_X - fabs(x))) -
                 0.30f * exp(-4.0f * (ROOM_Y - fabs(y)));
    for (int i = 0; i < BOXES; ++i) {
        __global const float *b = boxes + 8 * i;
        const float dx = fmax(fmax(b[0] - x, x - b[3]), 0.0f);
        const float dy = fmax(fmax(b[1] - y, y - b[4]), 0.0f);
        open *= 1.0f - 0.55f * exp(-(7.0f / (0.3f + b[5])) * sqrt(dx * dx + dy * dy));
    }
    return open;
}

// Colour (grey levels, BGR) of the empty room along the ray; *t its distance; *on_floor 1 or 0.
inline float3 room_colour(__global const float *posters, __global const float *boxes, float3 origin,
                          float3 ray, int seed, float *t, int *on_floor)
{
    const float3 half_size = (float3)(ROOM_X, ROOM_Y, 0.5f * ROOM_Z);
    const float3 from = origin - (float3)(0.0f, 0.0f, 0.5f * ROOM_Z);
    const float3 far = (copysign(half_size, ray) - from) / ray;
    *t = fmin(fmin(far.x, far.y), far.z);
    float3 n = *t == far.x ? (float3)(-sign(ray.x), 0.0f, 0.0f)
             : *t == far.y ? (float3)(0.0f, -sign(ray.y), 0.0f)
                           : (float3)(0.0f, 0.0f, -sign(ray.z));
    const int box = hit_boxes(boxes, origin, ray, t, &n);
    const float3 p = origin + *t * ray;
    *on_floor = box < 0 && n.z > 0.5f;
    float3 colour;
    float open = 1.0f;
    if (box >= 0) {
        colour = box_colour(boxes + 8 * box, p, n, seed + 50 * box);
        open = 1.0f - 0.35f * exp(-6.0f * p.z);
    } else if (*on_floor) {
        colour = floor_colour(p.x, p.y, seed);
        open = floor_openness(boxes, p.x, p.y);
    } else if (n.z < -0.5f) {
        colour = (float3)(0.75f);
    } else {
        const int wall = fabs(n.x) > 0.5f ? (n.x > 0.0f ? 0 : 2) : (n.y > 0.0f ? 1 : 3);
        colour = wall_colour(wall, fabs(n.x) > 0.5f ? p.y : p.x, p.z, posters, seed);
        open = 1.0f - 0.35f * exp(-5.0f * p.z);
        const float corner = fabs(n.x) > 0.5f ? ROOM_Y - fabs(p.y) : ROOM_X - fabs(p.x);
        open -= 0.25f * exp(-4.0f * corner);
    }
    return display(colour * lighting(p, n, open));
}

// Kernels ----------------------------------------------------------------------------------------

// tiles (V, TILES_Y, TILES_X, PRIMITIVES + 1): number, then indices of the primitives that some ray
// of the tile may meet. Wherever a primitive is, the tile's rays stray from its middle ray by at
// most tan(angle) times the distance.
__kernel void bin_primitives(__global const float *cameras, __global const float *primitives,
                             __global uchar *tiles)
{
    const int i = get_global_id(0), j = get_global_id(1), view = get_global_id(2);
    if (i >= TILES_X || j >= TILES_Y || view >= VIEWS) return;
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

// picture (V, H, W, 3) float: the empty room, 2 x 2 rays per pixel; distance (V, H, W): of
// the last of them; floor_point (V, H, W, 2): their mean point on the floor, FAR where it is none.
__kernel void empty_room(__global const float *cameras, __global const float *posters,
                         __global const float *boxes, const int seed, __global float *picture,
                         __global float *distance, __global float *floor_point)
{
    const int u = get_global_id(0), v = get_global_id(1), view = get_global_id(2);
    if (u >= WIDTH || v >= HEIGHT || view >= VIEWS) return;
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
    vstore3(0.25f * sum, id, picture);
}

// shadow (SHADOW_SIZE, SHADOW_SIZE): by how much the body (as spheres) darkens the floor, grey
// level factor, around `centre`. Ambient part: a sphere hides r^2 h / d^3 of the sky; direct part:
// penumbra of a lamp of radius LAMP_RADIUS.
__kernel void floor_shadow(__global const float *balls, const float2 centre,
                           __global float *shadow)
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
    shadow[j * SHADOW_SIZE + i] = mix(sqrt(factor), 1.0f, smoothstep(0.85f, 0.99f, rim));
}

// The room's pixel under the person's shadow: bilinear look-up of the shadow map.
inline float3 shadowed_room(__global const float *room, __global const float *floor_point,
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

inline __global const uchar *tile_of(__global const uchar *tiles, int u, int v, int view)
{
    return tiles + ((view * TILES_Y + v / TILE) * TILES_X + u / TILE) * (PRIMITIVES + 1);
}

// picture (V, H, W, 3) float grey levels, mask (V, H, W) 0/255 and depth (V, H, W) m (0 = no
// person) from the rays through pixel centres.
__kernel void render(__global const float *cameras, __global const float *primitives,
                     __global const uchar *tiles, __global const float *palette,
                     __global const float *room, __global const float *distance,
                     __global const float *floor_point, __global const float *shadow,
                     const float2 centre, __global float *picture, __global uchar *mask,
                     __global float *depth)
{
    const int u = get_global_id(0), v = get_global_id(1), view = get_global_id(2);
    if (u >= WIDTH || v >= HEIGHT || view >= VIEWS) return;
    const int id = (view * HEIGHT + v) * WIDTH + u;
    __global const uchar *tile = tile_of(tiles, u, v, view);
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
    vstore3(colour, id, picture);
    mask[id] = t > 0.0f ? 255 : 0;
    depth[id] = t * per_length;
}

// Smooth the silhouette: pixels whose neighbour is on its other side are covered by as much of the
// person as 2 x 2 rays meet.
__kernel void smooth_edges(__global const float *cameras, __global const float *primitives,
                           __global const uchar *tiles, __global const float *palette,
                           __global const float *room, __global const float *distance,
                           __global const float *floor_point, __global const float *shadow,
                           const float2 centre, __global const uchar *mask,
                           __global float *picture)
{
    const int u = get_global_id(0), v = get_global_id(1), view = get_global_id(2);
    if (u >= WIDTH || v >= HEIGHT || view >= VIEWS) return;
    const int id = (view * HEIGHT + v) * WIDTH + u;
    const uchar here = mask[id];
    if (mask[id - (u > 0)] == here && mask[id + (u < WIDTH - 1)] == here &&
        mask[id - (v > 0) * WIDTH] == here && mask[id + (v < HEIGHT - 1) * WIDTH] == here)
        return;
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    const float3 origin = camera_centre(camera);
    const float3 behind = shadowed_room(room, floor_point, shadow, centre, id);
    float3 person = vload3(id, picture);
    int hits = 0;
    for (int k = 0; k < 4; ++k) {
        const float2 pixel = (float2)(u + 0.5f * (k & 1) - 0.25f, v + 0.5f * (k >> 1) - 0.25f);
        float per_length;
        const float3 ray = camera_ray(camera, pixel, &per_length);
        uchar list[PRIMITIVES];
        int count;
        const float t = trace(primitives, tile_of(tiles, u, v, view), origin, ray, distance[id],
                              list, &count);
        if (t <= 0.0f) continue;
        if (!here && !hits) // the pixel's own ray missed: this one's colour serves
            person = shade_body(primitives, list, count, palette, origin + t * ray);
        ++hits;
    }
    vstore3(mix(behind, person, 0.25f * hits), id, picture);
}

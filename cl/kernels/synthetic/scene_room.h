// The room of the synthetic scene. Defines: ROOM_X, ROOM_Y, ROOM_Z (half width, half depth, height,
// m), POSTERS, BOXES.
#if !defined(BOXES) || !defined(POSTERS) || !defined(ROOM_X) || !defined(ROOM_Y) || \
    !defined(ROOM_Z)
#error "synthetic/scene_room.h needs BOXES, POSTERS, ROOM_X, ROOM_Y and ROOM_Z"
#endif
#include "synthetic/scene_light.h"
#include "synthetic/scene_noise.h"

INLINED float3 floor_colour(float x, float y, int seed)
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
INLINED float3 poster_colour(float u, float v, float edge, float style, float hue, int seed)
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

INLINED float3 wall_colour(int wall, float along, float z, __global const float *posters,
                           int seed)
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

INLINED float3 box_colour(__global const float *box, float3 p, float3 n, int seed)
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
INLINED int hit_boxes(__global const float *boxes, float3 origin, float3 ray, float *t,
                      float3 *n)
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
static inline float floor_openness(__global const float *boxes, float x, float y)
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
INLINED float3 room_colour(__global const float *posters, __global const float *boxes,
                           float3 origin, float3 ray, int seed, float *t, int *on_floor)
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

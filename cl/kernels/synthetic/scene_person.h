// The person of the synthetic scene: a smooth union of squashed round cones, sphere traced, and its
// look. Defines: PRIMITIVES; PRIMITIVE_FLOATS; HIT, FAR (m) and MARCH_STEPS of the tracing.
//
// A primitive is PRIMITIVE_FLOATS floats:
//   0-11 world -> its frame (3x3 row-major and offset; across axes divided by the squash)
//   12 length  13 radius at 0  14 taper m  15 m / sqrt(1 - m^2)  16-17 1 / squash  18 blend
//   19 group  20-23 bounding sphere  24 region  25 region beyond  26 split  27 rest height at 0
//   28 rest height per length  31 largest radius
#if !defined(FAR) || !defined(HIT) || !defined(MARCH_STEPS) || !defined(PRIMITIVE_FLOATS)
#error "synthetic/scene_person.h needs FAR, HIT, MARCH_STEPS and PRIMITIVE_FLOATS"
#endif
#include "synthetic/scene_light.h"
#include "synthetic/scene_noise.h"

#define MAX_BLEND 0.07f

// First-order distance (m) to one primitive; *along is the position on its axis.
INLINED float primitive_distance(__global const float *g, float3 p, float *along)
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
static inline float smooth_min(float a, float b, float k)
{
    const float h = fmax(k - fabs(a - b), 0.0f) / k;
    return fmin(a, b) - 0.25f * h * h * k;
}

// Distance to the listed primitives (in the order of their groups).
INLINED float body_distance(__global const float *primitives, const uchar *list, int count,
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
INLINED bool near_line(__global const float *g, float3 origin, float3 ray, float slack,
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
INLINED int primitives_on_ray(__global const float *primitives, __global const uchar *tile,
                              float3 origin, float3 ray, uchar *list, float *enter,
                              float *leave)
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
INLINED float trace(__global const float *primitives, __global const uchar *tile,
                    float3 origin, float3 ray, float limit, uchar *list, int *count)
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

// Linear colour of a point of the nearest primitive `g`, `along` its axis; palette: 3 per region,
// then the shirt's second colour.
INLINED float3 cloth_colour(__global const float *palette, __global const float *g,
                            float along, float3 p)
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

INLINED float3 body_normal(__global const float *primitives, const uchar *list, int count,
                           float3 p)
{
    const float e = 1.5e-3f;
    const float3 a = (float3)(e, -e, -e), b = (float3)(-e, -e, e), c = (float3)(-e, e, -e);
    const float3 d = (float3)(e, e, e);
    return normalize(a * body_distance(primitives, list, count, p + a) +
                     b * body_distance(primitives, list, count, p + b) +
                     c * body_distance(primitives, list, count, p + c) +
                     d * body_distance(primitives, list, count, p + d));
}

INLINED float3 shade_body(__global const float *primitives, const uchar *list, int count,
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

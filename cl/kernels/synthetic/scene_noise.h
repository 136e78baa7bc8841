// Noise and colours of the synthetic scene.
#include "common/inlined.h"

static inline float hash(int x, int y, int z)
{
    uint h = (uint)x * 0x8da6b343u ^ (uint)y * 0xd8163841u ^ (uint)z * 0xcb1ab31fu;
    h = (h ^ (h >> 15)) * 0x2c1b3c6du;
    h = (h ^ (h >> 12)) * 0x297a2d39u;
    return (float)((h ^ (h >> 15)) & 0xffffffu) / 16777216.0f;
}

// Smooth noise in [0, 1] with unit cells.
static inline float value_noise(float x, float y, int seed)
{
    const float fx = floor(x), fy = floor(y);
    const int ix = (int)fx, iy = (int)fy;
    float u = x - fx, v = y - fy;
    u = u * u * (3.0f - 2.0f * u);
    v = v * v * (3.0f - 2.0f * v);
    return mix(mix(hash(ix, iy, seed), hash(ix + 1, iy, seed), u),
               mix(hash(ix, iy + 1, seed), hash(ix + 1, iy + 1, seed), u), v);
}

static inline float fractal_noise(float x, float y, int seed)
{
    return 0.55f * value_noise(x, y, seed) + 0.30f * value_noise(2.1f * x, 2.1f * y, seed + 1) +
           0.15f * value_noise(4.3f * x, 4.3f * y, seed + 2);
}

// A saturated colour from a hue in [0, 1), linear BGR.
INLINED float3 hue_colour(float hue, float saturation, float value)
{
    const float3 k = fabs(fmod((float3)(hue * 6.0f + 2.0f, hue * 6.0f + 4.0f, hue * 6.0f),
                               (float3)(6.0f)) - 3.0f) - 1.0f;
    return value * mix((float3)(1.0f), clamp(k, 0.0f, 1.0f), saturation);
}

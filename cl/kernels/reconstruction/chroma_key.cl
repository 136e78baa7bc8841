// Log of the density of a screen of one colour over the foreground's, in counts of 1 / STEPS nats
// (psfs/background/chroma_key.py); twin: reference/silhouette.py.
// Defines: STEPS, LOWEST, HIGHEST as in silhouette.cl; AREA of all chromaticities;
// NOISE, grey levels of a channel; DARK, BRIGHT, the screen's range of light; LIGHT_WEIGHT (1 /
// variance of the light beyond it).
#if !defined(AREA) || !defined(BRIGHT) || !defined(DARK) || !defined(LIGHT_WEIGHT) || \
    !defined(NOISE) || !defined(STEPS)
#error "reconstruction/chroma_key.cl needs AREA, BRIGHT, DARK, LIGHT_WEIGHT, NOISE and STEPS"
#endif
#include "reconstruction/ratios.h"

// `keys` holds, per view: direction of the screen's chromaticity (2), saturation, variance along
// and across, brightness (sum of the channels), 0, 0. `screen` is 0 where a pixel has no say.
__kernel void chroma_ratio(int2 picture, __global const uchar *restrict images,
                           __global const float *restrict keys,
                           __global const uchar *restrict screen,
                           __global char *restrict ratios)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    const int pixel = (view * HEIGHT + y) * WIDTH + x;
    __global const uchar *colour = images + 3 * pixel;
    __global const float *key = keys + 8 * view;
    const int ib = colour[0], ig = colour[1], ir = colour[2];
    const float sum = ib + ig + ir + 1;
    const float u = (ir - ig) * 0.70710678f / sum, v = (ir + ig - 2 * ib) * 0.40824829f / sum;

    // More saturated than the screen is screen: shaded folds are.
    const float beyond = u * key[0] + v * key[1] - key[2];
    const float along = beyond < 0.0f ? beyond : 0.0f, across = v * key[0] - u * key[1];
    const float noise = NOISE * NOISE / (sum * sum);
    const float wide = key[3] + noise, high = key[4] + noise;
    const float light = sum / key[5];
    const float off = light < DARK ? DARK - light : (light > BRIGHT ? light - BRIGHT : 0.0f);
    const float least = along * along / wide + across * across / high + LIGHT_WEIGHT * off * off;
    const float nats = log(AREA / 6.2831853f) - 0.5f * (log(wide * high) + least);

    ratios[ratio_place(picture, view, x, y)] = screen[pixel] ? in_counts(STEPS * nats) : (char)0;
}

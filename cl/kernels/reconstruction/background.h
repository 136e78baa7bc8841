// Packs of neighbouring pixels, in a row, against the background. Define: that of pack.h.
#include "common/pack.h"
#include "common/sizes.h"

typedef struct { vfloat b, g, r; } Colour;

static inline Colour colour_of(__global const uchar *pixel)
{
#if PACK == 1
    return (Colour){pixel[0], pixel[1], pixel[2]};
#else // 24 bytes as they lie, spread to the channels
    const uchar16 first = (uchar16)(LOAD_PACK(pixel), LOAD_PACK(pixel + 8));
    const uchar8 last = LOAD_PACK(pixel + 16);
    return (Colour){TO_FLOAT((uchar8)(first.s0369, first.sCF, last.s25)),
                    TO_FLOAT((uchar8)(first.s147A, first.sD, last.s036)),
                    TO_FLOAT((uchar8)(first.s258B, first.sE, last.s147))};
#endif
}

// The pixels' mean, or their 1 / sigma^2, in the background's planes from `first` on.
static inline Colour planes_of(int2 picture, __global const float *plane, int first)
{
    const size_t step = PIXELS;
    plane += first * step;
    return (Colour){LOAD_PACK(plane), LOAD_PACK(plane + step), LOAD_PACK(plane + 2 * step)};
}

// A view's light, see psfs/background/light.py: LIGHT_FLOATS numbers of which the first are gains,
// offsets and the field. Colours of the background as pictures in that light show them, at pixel
// (x, y), which is the pack's first.
#define LIGHT_FLOATS 12

static inline vfloat field_of(__global const float *light, int x, int y)
{
    return light[6] + light[8] * y + light[7] * TO_FLOAT(x + LANE_NUMBERS);
}

static inline Colour lit(__global const float *light, vfloat field, Colour mean)
{
    return (Colour){least(light[0] * (mean.b * field) + light[3], 255.0f),
                    least(light[1] * (mean.g * field) + light[4], 255.0f),
                    least(light[2] * (mean.r * field) + light[5], 255.0f)};
}

static inline Colour lit_planes(int2 picture, __global const float *light,
                                __global const float *plane, int x, int y)
{
    return lit(light, field_of(light, x, y), planes_of(picture, plane, 0));
}

// Colours of a picture as they are in the background's own light.
static inline Colour unlit(__global const float *light, Colour shown, int x, int y)
{
    const vfloat field = field_of(light, x, y);
    return (Colour){(shown.b - light[3]) / (light[0] * field),
                    (shown.g - light[4]) / (light[1] * field),
                    (shown.r - light[5]) / (light[2] * field)};
}

// 1 / sigma^2 in that light.
static inline Colour weight_in(__global const float *light, Colour w)
{
    return (Colour){light[9] * w.b, light[9] * w.g, light[9] * w.r};
}

// Sum of w x y over the channels.
static inline vfloat weighed(Colour w, Colour x, Colour y)
{
    return w.b * x.b * y.b + w.g * x.g * y.g + w.r * x.r * y.r;
}

static inline Colour less(Colour x, vfloat factor, Colour y)
{
    return (Colour){x.b - factor * y.b, x.g - factor * y.g, x.r - factor * y.r};
}

// The factor that takes y nearest to x, and the squared distance that a factor leaves.
static inline vfloat fitting(Colour w, Colour x, Colour y)
{
    return weighed(w, x, y) / (weighed(w, y, y) + 1e-6f);
}

static inline vfloat distance_left(Colour w, Colour x, vfloat factor, Colour y)
{
    const Colour rest = less(x, factor, y);
    return weighed(w, rest, rest);
}

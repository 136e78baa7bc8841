// Packs of neighbouring pixels, in a row, against the background. Defines: WIDTH, HEIGHT; that of
// pack.h.
#if !defined(HEIGHT) || !defined(WIDTH)
#error "reconstruction/background.h needs HEIGHT and WIDTH"
#endif
#include "common/pack.h"

#define PIXELS (WIDTH * HEIGHT)

typedef struct { vfloat b, g, r; } Colour;

static inline Colour colour_of(__global const uchar *pixel)
{
#if PACK == 1
    return (Colour){pixel[0], pixel[1], pixel[2]};
#else // 24 bytes as they lie, spread to the channels
    const uchar16 first = (uchar16)(LOAD_BYTES(pixel), LOAD_BYTES(pixel + 8));
    const uchar8 last = LOAD_BYTES(pixel + 16);
    return (Colour){TO_FLOAT((uchar8)(first.s0369, first.sCF, last.s25)),
                    TO_FLOAT((uchar8)(first.s147A, first.sD, last.s036)),
                    TO_FLOAT((uchar8)(first.s258B, first.sE, last.s147))};
#endif
}

// The pixels' mean, or their 1 / sigma^2, in the background's planes from `first` on.
static inline Colour planes_of(__global const float *plane, int first)
{
    plane += first * PIXELS;
    return (Colour){LOAD_PACK(plane), LOAD_PACK(plane + PIXELS), LOAD_PACK(plane + 2 * PIXELS)};
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

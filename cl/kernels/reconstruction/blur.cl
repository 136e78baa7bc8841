// Evidence that reaches as far as outlines and calibration are uncertain; twin: reference/surface.py.
// An item has PACK pixels of a row.
// Defines: BLUR, px; PACK, 1 or 16; UNKNOWN, the evidence count of a pixel that says nothing.
#if !defined(BLUR) || !defined(PACK) || !defined(UNKNOWN)
#error "reconstruction/blur.cl needs BLUR, PACK and UNKNOWN"
#endif
#include "common/pack.h"
#include "common/sizes.h"

// Is the evidence from row `first` to `last` the same wherever the pack at column x looks? Most of a
// picture is background as sure as can be.
static inline bool is_uniform(int2 picture, __global const char *map, int x, int first, int last)
{
#if PACK == 1
    return false;
#else
    const vchar corner = map[first * WIDTH + x];
    vchar unlike = 0;
    for (int j = first; j <= last; ++j)
        for (int i = -BLUR; i < BLUR + PACK; i += PACK)
            unlike |= LOAD_PACK(map + j * WIDTH + x + (i < BLUR ? i : BLUR)) ^ corner;
    const long2 words = as_long2(unlike);
    return (words.x | words.y) == 0;
#endif
}

// The largest evidence within BLUR + 1/2 px of each pixel. Unknown evidence stays so, unless there
// is foreground.
__kernel void blur(int2 picture, __global const char *restrict evidence,
                   __global char *restrict blurred)
{
    const int x = PACK * get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    __global const char *map = evidence + view * (WIDTH * HEIGHT);
    __global char *target = blurred + view * (WIDTH * HEIGHT) + y * WIDTH;
    const int first = max(y - BLUR, 0), last = min(y + BLUR, HEIGHT - 1);
    // Packs near the ends of a row lie further inside; what they leave out goes one by one.
    const int begin = min(max(x, BLUR), WIDTH - PACK - BLUR);
    const bool packed = begin >= BLUR;
    if (packed) {
        const vchar own = LOAD_PACK(map + y * WIDTH + begin);
        vchar largest = own;
        if (!is_uniform(picture, map, begin, first, last))
            for (int j = first; j <= last; ++j)
                for (int i = -BLUR; i <= BLUR; ++i)
                    if (i * i + (j - y) * (j - y) <= BLUR * (BLUR + 1)) {
                        const vchar near = LOAD_PACK(map + j * WIDTH + begin + i);
                        largest = near > largest ? near : largest;
                    }
        const vchar kept = own == (vchar)(UNKNOWN) && largest <= (vchar)(0) ? own : largest;
        STORE_PACK(kept, target + begin);
    }
    for (int at = x; at < min(x + PACK, WIDTH); ++at) {
        if (packed && at >= begin && at < begin + PACK) continue;
        const char own = map[y * WIDTH + at];
        char largest = own;
        for (int j = first; j <= last; ++j)
            for (int i = max(at - BLUR, 0); i <= min(at + BLUR, WIDTH - 1); ++i)
                if ((i - at) * (i - at) + (j - y) * (j - y) <= BLUR * (BLUR + 1))
                    largest = max(largest, map[j * WIDTH + i]);
        target[at] = own == UNKNOWN && largest <= 0 ? own : largest;
    }
}

// Evidence that reaches as far as the cameras' calibration is uncertain; twin: reference/surface.py.
// An item has LOT pixels of a row.
// Defines: BLUR, px; LOT, 16; UNKNOWN, the evidence count of a pixel that says nothing.
#if !defined(BLUR) || !defined(LOT) || !defined(UNKNOWN)
#error "reconstruction/blur.cl needs BLUR, LOT and UNKNOWN"
#endif
#if LOT != 16
#error "blur.cl: lots are vectors of 16"
#endif
#include "common/sizes.h"

// The largest evidence within BLUR + 1/2 px of each pixel. Unknown evidence stays so, unless there
// is foreground.
__kernel void blur(int2 picture, __global const char *restrict evidence,
                   __global char *restrict blurred)
{
    const int x = LOT * get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    __global const char *map = evidence + view * (WIDTH * HEIGHT);
    __global char *target = blurred + view * (WIDTH * HEIGHT) + y * WIDTH;
    const int first = max(y - BLUR, 0), last = min(y + BLUR, HEIGHT - 1);
    if (x >= BLUR && x + LOT + BLUR <= WIDTH) {
        const char16 own = vload16(0, map + y * WIDTH + x);
        char16 most = own;
        for (int j = first; j <= last; ++j)
            for (int i = -BLUR; i <= BLUR; ++i)
                if (i * i + (j - y) * (j - y) <= BLUR * (BLUR + 1))
                    most = max(most, vload16(0, map + j * WIDTH + x + i));
        const char16 unknown = (own == (char16)(UNKNOWN)) & (most <= (char16)(0));
        vstore16(select(most, own, unknown), 0, target + x);
        return;
    }
    for (int at = x; at < min(x + LOT, WIDTH); ++at) {
        const char own = map[y * WIDTH + at];
        char most = own;
        for (int j = first; j <= last; ++j)
            for (int i = max(at - BLUR, 0); i <= min(at + BLUR, WIDTH - 1); ++i)
                if ((i - at) * (i - at) + (j - y) * (j - y) <= BLUR * (BLUR + 1))
                    most = max(most, map[j * WIDTH + i]);
        target[at] = own == UNKNOWN && most <= 0 ? own : most;
    }
}

// Evidence that reaches as far as the cameras' calibration is uncertain; twin: reference/surface.py.
// Defines: BLUR, px; UNKNOWN, the evidence count of a pixel that says nothing.
#if !defined(BLUR) || !defined(UNKNOWN)
#error "reconstruction/blur.cl needs BLUR and UNKNOWN"
#endif
#include "common/sizes.h"

// The largest evidence within BLUR + 1/2 px of each pixel. Unknown evidence stays so, unless there
// is foreground.
__kernel void blur(int2 picture, __global const char *restrict evidence,
                   __global char *restrict blurred)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    __global const char *map = evidence + view * (WIDTH * HEIGHT);
    const char own = map[y * WIDTH + x];
    char most = own;
    for (int j = max(y - BLUR, 0); j <= min(y + BLUR, HEIGHT - 1); ++j)
        for (int i = max(x - BLUR, 0); i <= min(x + BLUR, WIDTH - 1); ++i)
            if ((i - x) * (i - x) + (j - y) * (j - y) <= BLUR * (BLUR + 1))
                most = max(most, map[j * WIDTH + i]);
    blurred[(view * HEIGHT + y) * WIDTH + x] = own == UNKNOWN && most <= 0 ? own : most;
}

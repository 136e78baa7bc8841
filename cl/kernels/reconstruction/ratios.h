// Log ratios of single pixels, background over foreground, in counts of 1 / STEPS nats.
// Defines: LOWEST and HIGHEST (counts); that of pack.h.
#if !defined(HIGHEST) || !defined(LOWEST)
#error "reconstruction/ratios.h needs HIGHEST and LOWEST"
#endif
#include "common/pack.h"
#include "common/sizes.h"

// Whole counts of a log ratio, within the limits of a single pixel.
static inline vchar in_counts(vfloat ratio)
{
    return TO_CHAR(LOWEST + TO_INT(within(ratio, LOWEST, HIGHEST) - LOWEST + 0.5f));
}

// Where the ratio of a pixel lies in the maps of all views, which have a border of one pixel. So
// the 3x3 pixels around pixel (x, y) begin at the place of (x - 1, y - 1).
static inline size_t ratio_place(int2 picture, int view, int x, int y)
{
    return ((size_t)view * (HEIGHT + 2) + y + 1) * (WIDTH + 2) + x + 1;
}

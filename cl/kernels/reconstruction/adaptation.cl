// The background follows the scene's light where nobody stands; twin: reference/adaptation.py.
// PARTS work-items per block of the picture, every PERIOD-th row of blocks a time; a block is as
// high as a cell of CELL x CELL pixels and as wide as a cell or a pack.
// Defines: CELL; PARTS (divides CELL); PERIOD; NEAREST
// (squared distance); LEAST_VARIANCE; WIDTH_GREY, WIDTH_COLOUR of the light factor
// (psfs/background/config.py); PACK. rates: of the mean and of the variance.
#if !defined(CELL) || !defined(LEAST_VARIANCE) || !defined(NEAREST) || !defined(PACK) || \
    !defined(PARTS) || !defined(PERIOD) || !defined(WIDTH_COLOUR) || !defined(WIDTH_GREY)
#error "reconstruction/adaptation.cl needs CELL, LEAST_VARIANCE, NEAREST, PACK, PARTS, PERIOD, WIDTH_COLOUR and WIDTH_GREY"
#endif
#include "reconstruction/background.h"
#include "reconstruction/cells.h"

#define BLOCK (CELL > PACK ? CELL : PACK)
#define BLOCKS_X ((WIDTH + BLOCK - 1) / BLOCK)

// Does a voxel show near the cell, or foreground in it?
static inline int is_person(int2 picture, __global const uchar *near, __global const char *evidence, int x,
                            int y)
{
    int found = near[y * CELLS_X + x];
    const int bottom = min(CELL * (y + 1), HEIGHT), right = min(CELL * (x + 1), WIDTH);
    for (int row = CELL * y; row < bottom; ++row)
        for (int column = CELL * x; column < right; ++column)
            found |= evidence[row * WIDTH + column] > 0;
    return found;
}

// Stores the pixels that are this work-item's `own`; of a `whole` pack all are.
static inline void store_own(vfloat values, vint own, bool whole, __global float *plane)
{
    if (whole) {
        STORE_PACK(values, plane);
        return;
    }
    float one[PACK];
    int taken[PACK];
    STORE_PACK(values, one);
    STORE_PACK(own, taken);
    for (int l = 0; l < PACK; ++l)
        if (taken[l]) plane[l] = one[l];
}

// A channel of a pixel that looks like the background, `d` brighter than it: its new mean and
// variance.
static inline vfloat follow(float2 rates, vfloat d, vfloat weight, vfloat *mean)
{
    const vfloat before = 1.0f / weight;
    *mean += rates.x * d;
    return most(before + rates.y * (d * d - before), LEAST_VARIANCE);
}

// `background` holds the planes of log_ratio in silhouette.cl; `light` that of light.cl, `near` that of
// appearance.cl.
__kernel void adapt(int2 picture, __global const uchar *restrict images, __global const char *restrict evidence,
                    __global const uchar *restrict near, __global const int2 *restrict sizes,
                    __global const float *restrict light, float2 rates, const int phase,
                    __global float *restrict background)
{
    const int block = get_global_id(0), view = get_global_id(2), part = get_global_id(1) % PARTS;
    const int y = get_global_id(1) / PARTS * PERIOD + phase;
    if (block >= BLOCKS_X || y >= CELLS_Y) return;
    int hidden[BLOCK / CELL];
    for (int k = 0; k < BLOCK / CELL; ++k) {
        const int x = block * (BLOCK / CELL) + k;
        hidden[k] = x >= CELLS_X || is_person(picture, near + view * CELLS_X * CELLS_Y,
                                              evidence + view * PIXELS, x, y);
    }
    __global const float *own_light = light + LIGHT_FLOATS * view;
    const int top = CELL * y + CELL / PARTS * part;
    const int bottom = min(top + CELL / PARTS, sizes[view].y);
    const int right = min(BLOCK * (block + 1), sizes[view].x);
    for (int row = top; row < bottom; ++row)
        for (int first = BLOCK * block; first < right; first += PACK) {
            const int x = first < WIDTH - PACK ? first : WIDTH - PACK, pixel = row * WIDTH + x;
            const bool whole = x == first && x + PACK <= right;
            const vint column = x + LANE_NUMBERS, cell = (column - BLOCK * block) / CELL;
            const vint own = (column >= first) & (column < right);
            __global float *plane = background + (size_t)view * 8 * PIXELS + pixel;
            const Colour shown = colour_of(images + 3 * (view * PIXELS + pixel));
            const Colour w = planes_of(picture, plane, 3), before = planes_of(picture, plane, 0);
            const Colour d = less(unlit(own_light, shown, x, row), 1.0f, before);
            vint looks_so = own & (own_light[9] * weighed(w, d, d) <= NEAREST);
            for (int k = 0; k < BLOCK / CELL; ++k)
                looks_so &= (cell != k) | (vint)(hidden[k] ? 0 : -1);

            if (!PACK_ANY(looks_so)) continue;

            Colour mean = before, variance;
            variance.b = follow(rates, d.b, w.b, &mean.b);
            variance.g = follow(rates, d.g, w.g, &mean.g);
            variance.r = follow(rates, d.r, w.r, &mean.r);
            const vfloat brightest = most(most(mean.b, mean.g), mean.r);
            const vfloat darkest = least(least(mean.b, mean.g), mean.r);
            const vfloat saturation = (brightest - darkest) / most(brightest, 1.0f);
            const vfloat width = WIDTH_GREY + saturation * (WIDTH_COLOUR - WIDTH_GREY);
            const vfloat peak = 1.5f * log(65536.0f / 6.2831853f) -
                                0.5f * log(variance.b * variance.g * variance.r);
            __global float *spread = plane + 3 * PIXELS;
            const bool all = whole && !PACK_ANY(looks_so == 0);
            store_own(mean.b, looks_so, all, plane);
            store_own(mean.g, looks_so, all, plane + PIXELS);
            store_own(mean.r, looks_so, all, plane + 2 * PIXELS);
            store_own(1.0f / variance.b, looks_so, all, spread);
            store_own(1.0f / variance.g, looks_so, all, spread + PIXELS);
            store_own(1.0f / variance.r, looks_so, all, spread + 2 * PIXELS);
            store_own(peak, looks_so, all, spread + 3 * PIXELS);
            store_own(1.0f / (width * width), looks_so, all, spread + 4 * PIXELS);
        }
}

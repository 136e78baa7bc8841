// The background follows the scene's light where nobody stands; twin: reference/adaptation.py.
// PARTS work-items per cell of CELL x CELL pixels, every PERIOD-th row of cells a time. Where it
// does not know better, a pixel takes on the change that the others of the view have seen.
// Defines: WIDTH, HEIGHT; CELLS_X, CELLS_Y, CELL; PARTS (divides CELL); REACH (cells of border of
// the marks); PERIOD; MEAN_RATE, VARIANCE_RATE; NEAREST (squared distance); LEAST_VARIANCE;
// WIDTH_GREY, WIDTH_COLOUR of the light factor (psfs/config.py); ENOUGH, grey levels seen that tell
// a view's change; LOOKED_AT, work-items of a view; GROUP.
#include "reduction.h"

#define PIXELS (WIDTH * HEIGHT)
#define MARKS_X (CELLS_X + 2 * REACH)
#define MARKS_Y (CELLS_Y + 2 * REACH)

// Does a voxel show in the cells around, or foreground in the cell?
inline int is_person(__global const uchar *marks, __global const char *evidence, int x, int y)
{
    int found = 0;
    for (int row = 0; row <= 2 * REACH; ++row)
        for (int column = 0; column <= 2 * REACH; ++column)
            found |= marks[(y + row) * MARKS_X + x + column];
    const int bottom = min(CELL * (y + 1), HEIGHT), right = min(CELL * (x + 1), WIDTH);
    for (int row = CELL * y; row < bottom; ++row)
        for (int column = CELL * x; column < right; ++column)
            found |= evidence[row * WIDTH + column] > 0;
    return found;
}

// drift = by which share the background of each view got brighter, from what the view's cells have
// seen of it. One work-group per view.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void view_drift(__global const float2 *restrict changes, __global float *restrict drift)
{
    __local float scratch[GROUP];
    const int view = get_group_id(0);
    float change = 0.0f, seen = 0.0f;
    for (int i = get_local_id(0); i < LOOKED_AT; i += GROUP) {
        change += changes[view * LOOKED_AT + i].x;
        seen += changes[view * LOOKED_AT + i].y;
    }
    change = group_sum(scratch, change);
    seen = group_sum(scratch, seen);
    if (get_local_id(0) == 0) drift[view] = seen >= ENOUGH ? MEAN_RATE * change / seen : 0.0f;
}

// `background` holds the planes of log_ratio in silhouette.cl; changes: (V, LOOKED_AT), by how many
// grey levels the background of a work-item's pixels changed, and their grey levels before.
__kernel void adapt(__global const uchar *restrict images, __global const char *restrict evidence,
                    __global const uchar *restrict marks, __global const int2 *restrict sizes,
                    const int phase, __global float *restrict background,
                    __global const float *restrict drift, __global float2 *restrict changes)
{
    const int x = get_global_id(0), view = get_global_id(2), part = get_global_id(1) % PARTS;
    const int y = get_global_id(1) / PARTS * PERIOD + phase;
    const int place = get_global_id(1) * CELLS_X + x;
    if (x >= CELLS_X || place >= LOOKED_AT) return;
    if (y >= CELLS_Y) {
        changes[view * LOOKED_AT + place] = (float2)(0.0f, 0.0f);
        return;
    }
    const int hidden =
        is_person(marks + view * MARKS_X * MARKS_Y, evidence + view * PIXELS, x, y);
    float change = 0.0f, seen = 0.0f;
    const int top = CELL * y + CELL / PARTS * part;
    const int bottom = min(top + CELL / PARTS, sizes[view].y);
    const int right = min(CELL * (x + 1), sizes[view].x);
    for (int row = top; row < bottom; ++row)
        for (int column = CELL * x; column < right; ++column) {
            const int pixel = row * WIDTH + column;
            __global const uchar *colour = images + 3 * (view * PIXELS + pixel);
            __global float *plane = background + (size_t)view * 8 * PIXELS + pixel;
            float difference[3], distance = 0.0f;
            for (int c = 0; c < 3; ++c) {
                difference[c] = colour[c] - plane[c * PIXELS];
                distance += plane[(3 + c) * PIXELS] * difference[c] * difference[c];
            }
            if (hidden || distance > NEAREST) {
                for (int c = 0; c < 3; ++c) plane[c * PIXELS] *= 1.0f + drift[view];
                continue;
            }
            float variances = 1.0f, brightest = 0.0f, darkest = 256.0f;
            for (int c = 0; c < 3; ++c) {
                const float d = difference[c], before = 1.0f / plane[(3 + c) * PIXELS];
                const float drifted = before + VARIANCE_RATE * (d * d - before);
                const float variance = drifted > LEAST_VARIANCE ? drifted : LEAST_VARIANCE;
                const float mean = plane[c * PIXELS] + MEAN_RATE * d;
                change += d;
                seen += plane[c * PIXELS];
                plane[c * PIXELS] = mean;
                plane[(3 + c) * PIXELS] = 1.0f / variance;
                variances *= variance;
                brightest = mean > brightest ? mean : brightest;
                darkest = mean < darkest ? mean : darkest;
            }
            const float saturation = (brightest - darkest) / (brightest > 1.0f ? brightest : 1.0f);
            const float width = WIDTH_GREY + saturation * (WIDTH_COLOUR - WIDTH_GREY);
            plane[6 * PIXELS] = 1.5f * log(65536.0f / 6.2831853f) - 0.5f * log(variances);
            plane[7 * PIXELS] = 1.0f / (width * width);
        }
    changes[view * LOOKED_AT + place] = (float2)(change, seen);
}

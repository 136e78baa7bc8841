// Silhouette likelihood maps, Song et al. eq. (1)-(2), as evidence counts (see psfs/config.py).
// Defines: WIDTH, HEIGHT; for pictures also VIEWS, FLOOR (m), SHADOW_LOW, SHADOW_HIGH, FLOOR_LOW,
// FLOOR_LIT, FLOOR_WEIGHT (1 / variance of the light factor), FLOOR_LEFT (squared distance), STEPS (counts of log ratio per nat), LOWEST and
// HIGHEST (counts), BINS of a colour channel, CELL (px), CELLS_X, CELLS_Y of the cells.
#include "camera.h"

// Is the pixel inside the picture of its view, which may be smaller than the stack of views?
inline bool in_picture(__global const int2 *sizes, int view, int x, int y)
{
    return x < sizes[view].x && y < sizes[view].y;
}

#ifdef BINS
#define PIXELS (WIDTH * HEIGHT)

// clamp(), which PoCL does not inline into vector code.
inline float limit(float x, float low, float high)
{
    return x < low ? low : (x > high ? high : x);
}

// Light factor that explains the colour of a pixel of the background best, and in *left the squared
// distance that it leaves. `plane` points to the pixel in the first of the view's planes.
inline float light_factor(__global const uchar *colour, __global const float *plane, float *left)
{
    const float b = colour[0], g = colour[1], r = colour[2];
    const float mb = plane[0], mg = plane[PIXELS], mr = plane[2 * PIXELS];
    const float wb = plane[3 * PIXELS], wg = plane[4 * PIXELS], wr = plane[5 * PIXELS];
    const float across = wb * b * mb + wg * g * mg + wr * r * mr;
    const float along = wb * mb * mb + wg * mg * mg + wr * mr * mr;
    const float alpha = across / (along + 1e-6f);
    const float db = b - alpha * mb, dg = g - alpha * mg, dr = r - alpha * mr;
    *left = wb * db * db + wg * dg * dg + wr * dr * dr;
    return alpha;
}

// The light on the floor behind every cell: the brightest that any other camera sees there, told
// in steps of 1 / 127, times 2, plus 1 where there is floor at all. A camera whose pixel cannot be
// floor, shaded or not, has no say; where nobody has, the floor is lit. The person who hides
// the floor from some cameras may be dark like a shadow, but others see the floor beside him.
// A cell whose middle shows the floor lit asks nobody.
// `points` holds the floor behind a cell (x, y), NaN if there is none. `light` has a border of one
// cell, which repeats the outermost.
__kernel void floor_light(__global const float *restrict cameras,
                          __global const float2 *restrict points,
                          __global const uchar *restrict images,
                          __global const float *restrict background,
                          __global uchar *restrict light)
{
    const int column = get_global_id(0), row = get_global_id(1), view = get_global_id(2);
    if (column >= CELLS_X + 2 || row >= CELLS_Y + 2) return;
    const int x = min(max(column - 1, 0), CELLS_X - 1), y = min(max(row - 1, 0), CELLS_Y - 1);
    const float2 point = points[(view * CELLS_Y + y) * CELLS_X + x];
    const int on_floor = point.x == point.x;
    const int middle = min(CELL * y + CELL / 2, HEIGHT - 1) * WIDTH +
                       min(CELL * x + CELL / 2, WIDTH - 1);
    float left;
    const float own = light_factor(images + 3 * (view * PIXELS + middle),
                                   background + (size_t)view * 8 * PIXELS + middle, &left);
    const int asks = on_floor && (own <= FLOOR_LIT || left >= FLOOR_LEFT);
    float brightest = 0.0f;
    for (int other = 0; asks && other < VIEWS; ++other) {
        if (other == view) continue;
        __global const float *camera = cameras + other * CAMERA_FLOATS;
        float2 pixel;
        const float depth = camera_project(camera, point.x, point.y, FLOOR, &pixel);
        const int at = camera_offset(camera, pixel, WIDTH);
        if (depth <= 0.0f || at < 0) continue;
        const float alpha = light_factor(images + 3 * (other * PIXELS + at),
                                         background + (size_t)other * 8 * PIXELS + at, &left);
        if (left < FLOOR_LEFT && alpha < SHADOW_HIGH && alpha > brightest) brightest = alpha;
    }
    const int told = brightest > 0.0f && brightest < 1.0f ? (int)(127.0f * brightest + 0.5f) : 127;
    light[(view * (CELLS_Y + 2) + row) * (CELLS_X + 2) + column] = 2 * told + on_floor;
}

// Log of the background's density over the foreground's, in counts of 1 / STEPS nats.
// `background` holds, per view, planes of floats: mean of the channels (3), 1 / sigma^2 of the
// channels (3), log of the background's peak density over the uniform foreground's, 1 / variance
// of the light factor. `colours` holds the log of the foreground's density over the uniform one,
// `place` the log odds of foreground by cell, both in counts. `ratios` has a border of one pixel.
__kernel void log_ratio(__global const uchar *restrict images,
                        __global const float *restrict background,
                        __global const int2 *restrict sizes,
                        __global const char *restrict colours,
                        __global const char *restrict place,
                        __global const uchar *restrict light,
                        __global char *restrict ratios)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    const int pixel = y * WIDTH + x;
    __global const uchar *colour = images + 3 * (view * PIXELS + pixel);
    __global const float *plane = background + (size_t)view * 8 * PIXELS + pixel;
    const int ib = colour[0], ig = colour[1], ir = colour[2];
    const float b = ib, g = ig, r = ir;
    const float mb = plane[0], mg = plane[PIXELS], mr = plane[2 * PIXELS];
    const float wb = plane[3 * PIXELS], wg = plane[4 * PIXELS], wr = plane[5 * PIXELS];

    // Squared distances to the background's colour in plain light, under less light, and, on the
    // floor, under the light that other cameras see, in between cells linearly.
    const float across = wb * b * mb + wg * g * mg + wr * r * mr;
    const float along = wb * mb * mb + wg * mg * mg + wr * mr * mr;
    const float factor = across / (along + 1e-6f);
    const float eb = b - mb, eg = g - mg, er = r - mr;
    float least = wb * eb * eb + wg * eg * eg + wr * er * er;

    const float alpha = limit(factor, SHADOW_LOW, SHADOW_HIGH);
    const float db = b - alpha * mb, dg = g - alpha * mg, dr = r - alpha * mr;
    const float shaded = wb * db * db + wg * dg * dg + wr * dr * dr +
                         plane[7 * PIXELS] * (1.0f - alpha) * (1.0f - alpha);
    least = shaded < least ? shaded : least;

    const int u = 2 * x - (CELL - 1) + 2 * CELL, v = 2 * y - (CELL - 1) + 2 * CELL;
    const int cx = u / (2 * CELL), cy = v / (2 * CELL);
    const int fx = u % (2 * CELL), fy = v % (2 * CELL);
    __global const uchar *corner = light + (view * (CELLS_Y + 2) + cy) * (CELLS_X + 2) + cx;
    const int upper = (2 * CELL - fx) * corner[0] + fx * corner[1];
    const int lower = (2 * CELL - fx) * corner[CELLS_X + 2] + fx * corner[CELLS_X + 3];
    const float seen = ((2 * CELL - fy) * upper + fy * lower) * (1.0f / (4 * CELL * CELL * 254));
    const int on_floor =
        light[(view * (CELLS_Y + 2) + y / CELL + 1) * (CELLS_X + 2) + x / CELL + 1] & 1;
    const float dim = limit(factor, FLOOR_LOW, SHADOW_HIGH);
    const float fb = b - dim * mb, fg = g - dim * mg, fr = r - dim * mr;
    const float darker = seen > dim ? seen - dim : 0.0f;
    const float on_it = wb * fb * fb + wg * fg * fg + wr * fr * fr +
                        FLOOR_WEIGHT * darker * darker + (1.0f - dim) * (1.0f - dim);
    least = on_floor && on_it < least ? on_it : least;

    const float uniform_ratio = plane[6 * PIXELS] - 0.5f * least;
    const int bin = ((ib * BINS >> 8) * BINS + (ig * BINS >> 8)) * BINS + (ir * BINS >> 8);
    const int odds = place[(view * CELLS_Y + y / CELL) * CELLS_X + x / CELL];
    const float ratio = STEPS * uniform_ratio - (colours[bin] + odds);
    const int counts = LOWEST + (int)(limit(ratio, LOWEST, HIGHEST) - LOWEST + 0.5f);
    ratios[((size_t)view * (HEIGHT + 2) + y + 1) * (WIDTH + 2) + x + 1] =
        in_picture(sizes, view, x, y) ? counts : 0;
}

// Sum of the ratios over 3x3 pixels, and by `table` the evidence of a voxel that projects there.
__kernel void silhouette(__global const char *restrict ratios, __global const int2 *restrict sizes,
                         __global const char *restrict table, __global char *restrict evidence)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    __global const char *corner = ratios + ((size_t)view * (HEIGHT + 2) + y) * (WIDTH + 2) + x;
    int sum = -9 * LOWEST;
#pragma unroll
    for (int row = 0; row < 3; ++row)
#pragma unroll
        for (int column = 0; column < 3; ++column) sum += corner[row * (WIDTH + 2) + column];
    const char counts = table[sum];
    evidence[(view * HEIGHT + y) * WIDTH + x] = in_picture(sizes, view, x, y) ? counts : (char)0;
}
#endif

// Ready masks, 0..255; `table` holds the evidence of the 256 values.
__kernel void mask_silhouette(__global const uchar *restrict masks,
                              __global const int2 *restrict sizes,
                              __global const char *restrict table,
                              __global char *restrict evidence)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    const int at = (view * HEIGHT + y) * WIDTH + x;
    evidence[at] = in_picture(sizes, view, x, y) ? table[masks[at]] : (char)0;
}

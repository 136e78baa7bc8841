// Silhouette likelihood maps, Song et al. eq. (1)-(2), as evidence counts (see psfs/config.py).
// Defines: WIDTH, HEIGHT; for pictures also SHADOW_LOW, SHADOW_HIGH, FLOOR_LOW, FLOOR_COST (nats),
// STEPS (counts of log ratio per nat), LOWEST and HIGHEST (counts), BINS of a colour channel, CELL,
// CELLS_X, CELLS_Y of the shadow zones.

// Is the pixel inside the picture of its view, which may be smaller than the stack of views?
inline bool in_picture(__global const int2 *sizes, int view, int x, int y)
{
    return x < sizes[view].x && y < sizes[view].y;
}

#ifdef BINS
// clamp(), which PoCL does not inline into vector code.
inline float limit(float x, float low, float high)
{
    return x < low ? low : (x > high ? high : x);
}

// Log of the background's density over the foreground's, in counts of 1 / STEPS nats.
// `background` holds, per view, planes of floats: mean of the channels (3), 1 / sigma^2 of the
// channels (3), log of the background's peak density over the uniform foreground's, 1 / variance
// of the light factor. `colours` holds the log of the foreground's density over the uniform one,
// `zone` the cells whose floor may lie in the person's shadow. `ratios` has a border of one pixel.
__kernel void log_ratio(__global const uchar *restrict images,
                        __global const float *restrict background,
                        __global const int2 *restrict sizes,
                        __global const char *restrict colours,
                        __global const uchar *restrict zone,
                        __global char *restrict ratios)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    const int pixel = y * WIDTH + x;
    __global const uchar *colour = images + 3 * (view * (WIDTH * HEIGHT) + pixel);
    __global const float *plane = background + (size_t)view * 8 * (WIDTH * HEIGHT) + pixel;
    const int ib = colour[0], ig = colour[1], ir = colour[2];
    const float b = ib, g = ig, r = ir;
    const float mb = plane[0], mg = plane[WIDTH * HEIGHT], mr = plane[2 * WIDTH * HEIGHT];
    const float wb = plane[3 * WIDTH * HEIGHT], wg = plane[4 * WIDTH * HEIGHT];
    const float wr = plane[5 * WIDTH * HEIGHT];
    const int dark = zone[(view * CELLS_Y + y / CELL) * CELLS_X + x / CELL];

    // The light factor that explains the pixel best, then the squared distance left over.
    const float across = wb * b * mb + wg * g * mg + wr * r * mr;
    const float along = wb * mb * mb + wg * mg * mg + wr * mr * mr;
    const float low = dark ? FLOOR_LOW : SHADOW_LOW;
    const float alpha = limit(across / (along + 1e-6f), low, SHADOW_HIGH);
    const float db = b - alpha * mb, dg = g - alpha * mg, dr = r - alpha * mr;
    const float dimming = (1.0f - alpha) * (1.0f - alpha);
    const float price = plane[7 * WIDTH * HEIGHT] * dimming;
    const float floor_price = dark ? 2.0f * FLOOR_COST + dimming : price;
    const float shaded = wb * db * db + wg * dg * dg + wr * dr * dr +
                         (floor_price < price ? floor_price : price);
    const float eb = b - mb, eg = g - mg, er = r - mr;
    const float plain = wb * eb * eb + wg * eg * eg + wr * er * er;

    const float uniform_ratio =
        plane[6 * WIDTH * HEIGHT] - 0.5f * (plain < shaded ? plain : shaded);
    const int bin = ((ib * BINS >> 8) * BINS + (ig * BINS >> 8)) * BINS + (ir * BINS >> 8);
    const float ratio = STEPS * uniform_ratio - colours[bin];
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

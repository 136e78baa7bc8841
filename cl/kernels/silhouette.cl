// Silhouette likelihood maps, Song et al. eq. (1)-(2), as evidence counts (see psfs/config.py).
// Defines: PIXELS of one view; WIDTH; for `silhouette` also SHADOW_LOW, SHADOW_HIGH,
// TABLE_LOW (nats), TABLE_STEP (entries per nat), TABLE_SIZE.

// Is the pixel inside the picture of its view, which may be smaller than the stack of views?
inline bool in_picture(__global const int2 *sizes, int view, int pixel)
{
    return pixel % WIDTH < sizes[view].x && pixel / WIDTH < sizes[view].y;
}

#ifdef TABLE_SIZE
// clamp(), which PoCL does not inline into vector code.
inline float limit(float x, float low, float high)
{
    return x < low ? low : (x > high ? high : x);
}

// `background` holds, per view, planes of PIXELS floats: mean of the channels (3), 1 / sigma^2
// of the channels (3), log of the background's peak density over the uniform foreground's,
// 1 / variance of the light factor.
// `table` turns the log ratio of the two densities into evidence.
__kernel void silhouette(__global const uchar *restrict images,
                         __global const float *restrict background,
                         __global const int2 *restrict sizes,
                         __global const char *restrict table,
                         __global char *restrict evidence)
{
    const int pixel = get_global_id(0), view = get_global_id(1);
    if (pixel >= PIXELS) return;
    __global const uchar *colour = images + 3 * (view * PIXELS + pixel);
    __global const float *plane = background + (size_t)view * 8 * PIXELS + pixel;
    const float b = colour[0], g = colour[1], r = colour[2];
    const float mb = plane[0], mg = plane[PIXELS], mr = plane[2 * PIXELS];
    const float wb = plane[3 * PIXELS], wg = plane[4 * PIXELS], wr = plane[5 * PIXELS];

    // The light factor that explains the pixel best, then the squared distance left over.
    const float across = wb * b * mb + wg * g * mg + wr * r * mr;
    const float along = wb * mb * mb + wg * mg * mg + wr * mr * mr;
    const float alpha = limit(across / (along + 1e-6f), SHADOW_LOW, SHADOW_HIGH);
    const float db = b - alpha * mb, dg = g - alpha * mg, dr = r - alpha * mr;
    const float shaded = wb * db * db + wg * dg * dg + wr * dr * dr +
                         plane[7 * PIXELS] * (1.0f - alpha) * (1.0f - alpha);
    const float eb = b - mb, eg = g - mg, er = r - mr;
    const float plain = wb * eb * eb + wg * eg * eg + wr * er * er;

    const float ratio = plane[6 * PIXELS] - 0.5f * (plain < shaded ? plain : shaded);
    const float entry = limit((ratio - TABLE_LOW) * TABLE_STEP, 0.0f, TABLE_SIZE - 1.0f);
    const char counts = table[(int)(entry + 0.5f)];
    evidence[view * PIXELS + pixel] = in_picture(sizes, view, pixel) ? counts : (char)0;
}
#endif

// Ready masks, 0..255; `table` holds the evidence of the 256 values.
__kernel void mask_silhouette(__global const uchar *restrict masks,
                              __global const int2 *restrict sizes,
                              __global const char *restrict table,
                              __global char *restrict evidence)
{
    const int pixel = get_global_id(0), view = get_global_id(1);
    if (pixel >= PIXELS) return;
    const int at = view * PIXELS + pixel;
    evidence[at] = in_picture(sizes, view, pixel) ? table[masks[at]] : (char)0;
}

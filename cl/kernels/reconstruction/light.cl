// The light of every picture beside that of the background; twin: reference/light.py. A robust fit
// of gains, offsets and a gain that grows linearly over the picture. One work-group per view.
// Defines: SAMPLES of a view; STEPS, WIDEST and NARROWEST (standard deviations) of
// the fit; INDEPENDENT; GAIN_PRIOR, OFFSET_PRIOR, FIELD_PRIOR (1 / variance); EXPECTED (squared
// spread); LEAST_GAIN, MOST_GAIN; LIGHT_FLOATS; GROUP; that of pack.h.
#if !defined(EXPECTED) || !defined(FIELD_PRIOR) || !defined(GAIN_PRIOR) || !defined(GROUP) || \
    !defined(INDEPENDENT) || !defined(LEAST_GAIN) || \
    !defined(LIGHT_FLOATS) || !defined(MOST_GAIN) || !defined(NARROWEST) || \
    !defined(OFFSET_PRIOR) || !defined(SAMPLES) || !defined(STEPS) || !defined(WIDEST)
#error "reconstruction/light.cl needs EXPECTED, FIELD_PRIOR, GAIN_PRIOR, GROUP, INDEPENDENT, LEAST_GAIN, LIGHT_FLOATS, MOST_GAIN, NARROWEST, OFFSET_PRIOR, SAMPLES, STEPS and WIDEST"
#endif
#include "common/pack.h"
#include "common/sizes.h"

// Samples of a work-item, in packs.
#define PACKS (SAMPLES / (GROUP * PACK))
// Sums: of each channel (lit^2, lit, 1, lit shown, shown); of the field (xx, xy, yy, x, y); of the
// residuals and of their weights.
#define SUMS 22
// Items that add up one sum first, and the floats from one sum's numbers to the next's: so that
// they lie in different banks.
#define ADDERS 8
#define PITCH (GROUP + ADDERS)

// totals[k] = sum of sums[k] over all lanes and items.
INLINED void add_up(const vfloat *sums, __local float *scratch, __local float *totals)
{
#if GROUP == 1
    for (int k = 0; k < SUMS; ++k) totals[k] = PACK_SUM(sums[k]);
#else
    const int lane = get_local_id(0), part = lane % ADDERS;
    for (int k = 0; k < SUMS; ++k) scratch[k * PITCH + lane] = PACK_SUM(sums[k]);
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int k = lane / ADDERS; k < SUMS; k += GROUP / ADDERS) {
        float sum = 0.0f;
        for (int i = part; i < GROUP; i += ADDERS) sum += scratch[k * PITCH + i];
        scratch[k * PITCH + GROUP + part] = sum;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int k = lane; k < SUMS; k += GROUP) {
        float sum = 0.0f;
        for (int i = 0; i < ADDERS; ++i) sum += scratch[k * PITCH + GROUP + i];
        totals[k] = sum;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
#endif
}

// `places`: (V, SAMPLES) pixels of a view. `scene`: (V, 8, SAMPLES) mean of the channels (3),
// 1 / sigma^2 (3), column and row from -1 to 1. `light`: (V, LIGHT_FLOATS), see
// psfs/background/light.py.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void estimate_light(int2 picture, __global const uchar *restrict images, __global const int2 *restrict sizes,
                    __global const int *restrict places, __global const float *restrict scene,
                    __global float *restrict light)
{
#if GROUP == 1
    __local float scratch[1];
#else
    __local float scratch[SUMS * PITCH];
#endif
    __local float totals[SUMS];
    const int view = get_group_id(0), first = PACK * get_local_id(0);
    __global const uchar *image = images + (size_t)3 * view * PIXELS;
    vfloat shown[3 * PACKS];
    for (int j = 0; j < PACKS; ++j) {
        __global const int *place = places + view * SAMPLES + PACK * GROUP * j + first;
        for (int c = 0; c < 3; ++c) {
#define BYTE_OF(l) image[3 * place[0x##l] + c]
            shown[3 * j + c] = TO_FLOAT(PACK_OF(vint, BYTE_OF));
#undef BYTE_OF
        }
    }
    float gain[3] = {1.0f, 1.0f, 1.0f}, offset[3] = {0.0f, 0.0f, 0.0f};
    float along = 0.0f, down = 0.0f, spread = 1.0f, scale = WIDEST;
    for (int step = 0; step < STEPS; ++step) {
        vfloat sums[SUMS];
        for (int k = 0; k < SUMS; ++k) sums[k] = 0.0f;
        const float sharpness = 1.0f / (3.0f * scale * scale);
        for (int j = 0; j < PACKS; ++j) {
            __global const float *sample = scene + 8 * view * SAMPLES + PACK * GROUP * j + first;
            const vfloat x = LOAD_PACK(sample + 6 * SAMPLES), y = LOAD_PACK(sample + 7 * SAMPLES);
            const vfloat field = 1.0f + along * x + down * y;
            vfloat distance = 0.0f, square = 0.0f, product = 0.0f, w[3], lit[3];
            for (int c = 0; c < 3; ++c) {
                const vfloat mean = LOAD_PACK(sample + c * SAMPLES);
                w[c] = LOAD_PACK(sample + (3 + c) * SAMPLES);
                lit[c] = mean * field;
                const vfloat rest = shown[3 * j + c] - (gain[c] * lit[c] + offset[c]);
                const vfloat bright = gain[c] * mean;
                distance += w[c] * rest * rest;
                square += w[c] * bright * bright;
                product += w[c] * bright * rest;
            }
            const vfloat unlike = 1.0f + sharpness * distance;
            const vfloat trust = 1.0f / (unlike * unlike);
            for (int c = 0; c < 3; ++c) {
                const vfloat weight = trust * w[c], weighed = weight * lit[c];
                sums[5 * c] += weighed * lit[c];
                sums[5 * c + 1] += weighed;
                sums[5 * c + 2] += weight;
                sums[5 * c + 3] += weighed * shown[3 * j + c];
                sums[5 * c + 4] += weight * shown[3 * j + c];
            }
            square *= trust;
            product *= trust;
            sums[15] += square * x * x;
            sums[16] += square * x * y;
            sums[17] += square * y * y;
            sums[18] += product * x;
            sums[19] += product * y;
            sums[20] += trust * distance;
            sums[21] += trust;
        }
        add_up(sums, scratch, totals);
        for (int c = 0; c < 3; ++c) {
            __local const float *of = totals + 5 * c;
            const float aa = INDEPENDENT * of[0] + GAIN_PRIOR, ab = INDEPENDENT * of[1];
            const float bb = INDEPENDENT * of[2] + OFFSET_PRIOR;
            const float a = INDEPENDENT * of[3] + GAIN_PRIOR, b = INDEPENDENT * of[4];
            const float determinant = aa * bb - ab * ab;
            gain[c] = fmin(fmax((a * bb - b * ab) / determinant, LEAST_GAIN), MOST_GAIN);
            offset[c] = (aa * b - ab * a) / determinant;
        }
        if (step > 0) { // before, the gains are far off
            const float xx = INDEPENDENT * totals[15] + FIELD_PRIOR, xy = INDEPENDENT * totals[16];
            const float yy = INDEPENDENT * totals[17] + FIELD_PRIOR;
            const float x = INDEPENDENT * totals[18] - FIELD_PRIOR * along;
            const float y = INDEPENDENT * totals[19] - FIELD_PRIOR * down;
            const float determinant = xx * yy - xy * xy;
            along += (x * yy - y * xy) / determinant;
            down += (xx * y - xy * x) / determinant;
        }
        spread = totals[20] / (3.0f * EXPECTED * totals[21] + 1e-6f);
        scale = fmax(0.5f * scale, NARROWEST);
#if GROUP > 1
        barrier(CLK_LOCAL_MEM_FENCE);
#endif
    }
    if (get_local_id(0) > 0) return;
    __global float *out = light + LIGHT_FLOATS * view;
    const float width = sizes[view].x, height = sizes[view].y;
    for (int c = 0; c < 3; ++c) {
        out[c] = gain[c];
        out[3 + c] = offset[c];
    }
    spread = fmax(spread, 1.0f);
    out[6] = 1.0f + along * (1.0f / width - 1.0f) + down * (1.0f / height - 1.0f);
    out[7] = 2.0f * along / width;
    out[8] = 2.0f * down / height;
    out[9] = 1.0f / spread;
    out[10] = 1.5f * log(spread);
}

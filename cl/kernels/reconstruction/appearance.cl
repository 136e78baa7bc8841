// What the reconstructed person teaches about the next frame (psfs/silhouettes/appearance.py): the
// colours that he wears, and the location prior, by where he was; twin: reference/appearance.py.
// Cells are CELL x CELL pixels.
// Defines: CELL; REACH (cells); BINS per channel; ROW of these; MIN_SURFACE; KEEP; UNIFORM; PRIOR; STEPS (table
// entries per nat).
#if !defined(BINS) || !defined(CAMERA_FLOATS) || !defined(CELL) || !defined(KEEP) || \
    !defined(MIN_SURFACE) || !defined(PRIOR) || !defined(REACH) || !defined(ROW) || !defined(STEPS) || !defined(UNIFORM)
#error "reconstruction/appearance.cl needs BINS, CAMERA_FLOATS, CELL, KEEP, MIN_SURFACE, PRIOR, REACH, ROW, STEPS and UNIFORM"
#endif
#include "common/camera.h"
#include "reconstruction/cells.h"
#include "reconstruction/voxels.h"

#define N_BINS (BINS * BINS * BINS)
#define MARKS_X (CELLS_X + 2 * REACH)
#define MARKS_Y (CELLS_Y + 2 * REACH)

// Marks the cells that show a voxel. `extents` holds, per view, half the width and height of a
// voxel's box times depth, cells m. `marks` has a border of REACH cells.
__kernel void mark(int2 picture, int3 grid, __global const float *restrict cameras, __global const float2 *restrict extents,
                   __global const float *restrict geometry, __global const int *restrict indices,
                   __global const int *restrict n_surface, __global uchar *restrict marks)
{
    const int view = get_global_id(1), n = *n_surface;
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    __global uchar *map = marks + (view * MARKS_Y + REACH) * MARKS_X + REACH;
    for (int i = get_global_id(0); i < n; i += get_global_size(0)) {
        const float3 centre = voxel_centre(grid, geometry, indices[i]);
        float2 pixel;
        const float depth = camera_project(camera, centre.x, centre.y, centre.z, &pixel);
        if (depth <= 0.0f) continue;
        const float2 half_size = extents[view] / depth;
        // Beside a camera both lie beyond what an int holds.
        const float2 low = fmin(fmax(ceil(pixel - half_size), 0.0f), (float2)(CELLS_X, CELLS_Y));
        const float2 high = fmin(floor(pixel + half_size), (float2)(CELLS_X - 1, CELLS_Y - 1));
        for (int row = (int)low.y; row <= (int)high.y; ++row)
            for (int column = (int)low.x; column <= (int)high.x; ++column)
                map[row * MARKS_X + column] = 1;
    }
}

// Log odds of foreground in the next frame: by `odds` from the number of marks within REACH cells,
// `near` if there are any; none when there is nobody. Counts the colours of marked cells that look
// like foreground.
__kernel void observe(int2 picture, __global const uchar *restrict marks, __global const char *restrict odds,
                      __global const int *restrict n_surface,
                      __global const uchar *restrict images, __global const char *restrict evidence,
                      __global char *restrict location, __global uchar *restrict near, __global int *restrict counts)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= CELLS_X || y >= CELLS_Y) return;
    __global const uchar *corner = marks + (view * MARKS_Y + y) * MARKS_X + x;
    int n_near = 0;
    for (int row = 0; row <= 2 * REACH; ++row)
        for (int column = 0; column <= 2 * REACH; ++column) n_near += corner[row * MARKS_X + column];
    const int cell = (view * CELLS_Y + y) * CELLS_X + x;
    location[cell] = *n_surface >= MIN_SURFACE ? odds[n_near] : (char)0;
    near[cell] = n_near > 0;

    const int column = CELL * x + CELL / 2, row = CELL * y + CELL / 2;
    if (!corner[REACH * MARKS_X + REACH] || column >= WIDTH || row >= HEIGHT) return;
    const int pixel = (view * HEIGHT + row) * WIDTH + column;
    if (evidence[pixel] <= 0) return;
    __global const uchar *colour = images + 3 * pixel;
    const int b = colour[0] * BINS / 256, g = colour[1] * BINS / 256, r = colour[2] * BINS / 256;
    const int bin = (b * BINS + g) * BINS + r;
    atomic_inc(&counts[bin]);
    atomic_inc(&counts[N_BINS]);
}

// memory = KEEP memory + counts, unless more than `most`, a person's share of the cells was counted.
// The last entry is the total.
__kernel void fade(int most, __global const int *restrict counts, __global float *restrict memory)
{
    const int bin = get_global_id(0);
    if (bin > N_BINS) return;
    memory[bin] = KEEP * memory[bin] + (counts[N_BINS] <= most ? counts[bin] : 0);
}

// Log density of the person's colours over the uniform one, in 1 / STEPS nats. The histogram is
// blurred by (1 2 1) / 4 along each channel, mixed with PRIOR samples of every colour alike, and
// keeps a share UNIFORM of colours never seen. The counts and the n_marks marks are cleared for the
// next frame. An item has ROW bins along the last channel.
__kernel void colour_table(__global const float *restrict memory, __global char *restrict table,
                           __global int *restrict counts, int n_marks, __global uchar *restrict marks)
{
    const int item = get_global_id(0), first = ROW * item;
    for (int i = item; i < n_marks; i += get_global_size(0)) marks[i] = 0;
    if (item == 0) counts[N_BINS] = 0;
    if (first >= N_BINS) return;
    const int b = first / (BINS * BINS), g = first / BINS % BINS, r = first % BINS;
    float sums[ROW], near[ROW + 2];
    for (int k = 0; k < ROW; ++k) sums[k] = 0.0f;
#pragma unroll
    for (int db = -1; db <= 1; ++db)
#pragma unroll
        for (int dg = -1; dg <= 1; ++dg) {
            if (b + db < 0 || g + dg < 0 || b + db >= BINS || g + dg >= BINS) continue;
            __global const float *row = memory + first + (db * BINS + dg) * BINS;
            near[0] = r > 0 ? row[-1] : 0.0f;
            for (int k = 0; k < ROW; ++k) near[k + 1] = row[k];
            near[ROW + 1] = r + ROW < BINS ? row[ROW] : 0.0f;
#pragma unroll
            for (int dr = -1; dr <= 1; ++dr) {
                const float weight = (2 - abs(db)) * (2 - abs(dg)) * (2 - abs(dr));
                for (int k = 0; k < ROW; ++k) sums[k] += weight * near[k + dr + 1];
            }
        }
    for (int k = 0; k < ROW; ++k) {
        const float samples = sums[k] / 64.0f * N_BINS;
        const float density = (PRIOR + samples) / (PRIOR + memory[N_BINS]);
        const float nats = log(UNIFORM + (1.0f - UNIFORM) * density);
        table[first + k] = (char)rint(fmin(STEPS * nats, 127.0f));
        counts[first + k] = 0;
    }
}

// What the reconstructed person teaches about the next frame (psfs/foreground.py): the colours
// that he wears, and where on the floor his shadow may lie. Cells are CELL x CELL pixels.
// Defines: WIDTH HEIGHT of the pictures; CELLS_X CELLS_Y; CELL; BINS per channel; FLOOR, FEET, HIPS, STRIDE (m);
// MARGIN (cells);
// NY NZ of the grid; MIN_SURFACE; KEEP; MOST; UNIFORM; PRIOR; STEPS (table entries per nat).
#include "camera.h"
#define N_BINS (BINS * BINS * BINS)

// Marks the cells that show a voxel above the feet, or what lies below such a voxel of a leg,
// MARGIN wider on every side.
// `extents` holds, per view, half the width and height of a voxel's box times depth, cells m.
__kernel void mark(__global const float *restrict cameras, __global const float2 *restrict extents,
                   __global const float *restrict geometry, // origin (3), voxel size
                   __global const int *restrict indices, __global const int *restrict n_surface,
                   __global uchar *restrict body)
{
    const int view = get_global_id(1), n = *n_surface;
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    __global uchar *map = body + (size_t)view * CELLS_X * CELLS_Y;
    for (int i = get_global_id(0); i < n; i += get_global_size(0)) {
        const int voxel = indices[i];
        const int x = voxel / (NY * NZ), y = voxel / NZ % NY, z = voxel % NZ;
        const float px = geometry[0] + (x + 0.5f) * geometry[3];
        const float py = geometry[1] + (y + 0.5f) * geometry[3];
        const float height = geometry[2] + (z + 0.5f) * geometry[3] - FLOOR;
        if (height <= FEET) continue;
        const int below = height < HIPS ? (int)((height - FEET) / STRIDE) : 0;
        for (int step = 0; step <= below; ++step) {
            float2 pixel;
            const float pz = FLOOR + height - step * STRIDE;
            const float depth = camera_project(camera, px, py, pz, &pixel);
            if (depth <= 0.0f) continue;
            const float2 half_size = extents[view] / depth + MARGIN;
            const float2 low = fmax(ceil(pixel - half_size), 0.0f);
            const float2 high = fmin(floor(pixel + half_size), (float2)(CELLS_X - 1, CELLS_Y - 1));
            for (int row = (int)low.y; row <= (int)high.y; ++row)
                for (int column = (int)low.x; column <= (int)high.x; ++column)
                    map[row * CELLS_X + column] = 1;
        }
    }
}

// Where a shadow may lie: on the floor, unless the cell is marked; nowhere when there is nobody.
// Counts the colours of marked cells that look like foreground. Clears the marks.
__kernel void observe(__global uchar *restrict body, __global const uchar *restrict on_floor,
                      __global const int *restrict n_surface,
                      __global const uchar *restrict images, __global const char *restrict evidence,
                      __global uchar *restrict zone, __global int *restrict counts)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= CELLS_X || y >= CELLS_Y) return;
    const int cell = (view * CELLS_Y + y) * CELLS_X + x;
    const int marked = body[cell];
    body[cell] = 0;
    zone[cell] = *n_surface >= MIN_SURFACE && on_floor[cell] && !marked;

    const int column = CELL * x + CELL / 2, row = CELL * y + CELL / 2;
    if (!marked || column >= WIDTH || row >= HEIGHT) return;
    const int pixel = (view * HEIGHT + row) * WIDTH + column;
    if (evidence[pixel] <= 0) return;
    __global const uchar *colour = images + 3 * pixel;
    const int b = colour[0] * BINS / 256, g = colour[1] * BINS / 256, r = colour[2] * BINS / 256;
    atomic_inc(&counts[(b * BINS + g) * BINS + r]);
    atomic_inc(&counts[N_BINS]);
}

// memory = KEEP memory + counts, unless more than a person's share of the cells was counted.
// The last entry is the total.
__kernel void fade(__global const int *restrict counts, __global float *restrict memory)
{
    const int bin = get_global_id(0);
    if (bin > N_BINS) return;
    memory[bin] = KEEP * memory[bin] + (counts[N_BINS] <= MOST ? counts[bin] : 0);
}

// Log density of the person's colours over the uniform one, in 1 / STEPS nats. The histogram is
// blurred by (1 2 1) / 4 along each channel, mixed with PRIOR samples of every colour alike, and
// keeps a share UNIFORM of colours never seen.
__kernel void colour_table(__global const float *restrict memory, __global char *restrict table)
{
    const int bin = get_global_id(0);
    if (bin >= N_BINS) return;
    const int b = bin / (BINS * BINS), g = bin / BINS % BINS, r = bin % BINS;
    float sum = 0.0f;
    for (int db = -1; db <= 1; ++db)
        for (int dg = -1; dg <= 1; ++dg)
            for (int dr = -1; dr <= 1; ++dr) {
                const int i = b + db, j = g + dg, k = r + dr;
                if (i < 0 || j < 0 || k < 0 || i >= BINS || j >= BINS || k >= BINS) continue;
                const int weight = (2 - abs(db)) * (2 - abs(dg)) * (2 - abs(dr));
                sum += weight * memory[(i * BINS + j) * BINS + k];
            }
    const float samples = sum / 64.0f * N_BINS;
    const float density = (PRIOR + samples) / (PRIOR + memory[N_BINS]);
    const float nats = log(UNIFORM + (1.0f - UNIFORM) * density);
    table[bin] = (char)rint(fmin(STEPS * nats, 127.0f));
}

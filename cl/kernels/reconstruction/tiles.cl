// Least and greatest evidence in tiles of pixels; twin: tests/psfs/voxels/test_sparse.py. Defines:
// those of bricks.h, LANES items per work-group.
#if !defined(LANES)
#error "reconstruction/tiles.cl needs LANES"
#endif
#include "common/lanes.h"
#include "reconstruction/bricks.h"

// Least and greatest evidence of the tiles, one work-group per coarse tile. Resets n_active.
__kernel void evidence_tiles(int2 picture, __global const char *restrict evidence,
                             __global char2 *restrict tiles,
                             __global int *restrict n_active)
{
    SCRATCH char2 fine[ALONG * ALONG];
    const int lane = get_local_id(0), view = get_group_id(1);
    const int coarse_x = get_group_id(0) % COARSE_X, coarse_y = get_group_id(0) / COARSE_X;
    __global const char *map = evidence + view * (WIDTH * HEIGHT);
    tiles += view * VIEW_TILES;
    if (lane == 0 && view == 0 && get_group_id(0) == 0) *n_active = 0;
    for (int t = lane; t < ALONG * ALONG; t += LANES) {
        const int x = coarse_x * ALONG + t % ALONG, y = coarse_y * ALONG + t / ALONG;
        char low[FINE], high[FINE]; // per column of the tile
        for (int i = 0; i < FINE; ++i) {
            low[i] = 127;
            high[i] = -127;
        }
        for (int j = y * FINE; j < y * FINE + FINE && j < HEIGHT; ++j)
            for (int i = 0; i < FINE; ++i) {
                const int at = x * FINE + i;
                // Columns beyond the picture repeat its last one.
                const char value = known_counts(map[j * WIDTH + (at < WIDTH ? at : WIDTH - 1)]);
                low[i] = value < low[i] ? value : low[i];
                high[i] = value > high[i] ? value : high[i];
            }
        for (int i = 1; i < FINE; ++i) {
            low[0] = low[i] < low[0] ? low[i] : low[0];
            high[0] = high[i] > high[0] ? high[i] : high[0];
        }
        fine[t] = (char2)(low[0], high[0]);
        if (x < FINE_X && y < FINE_Y) tiles[y * FINE_X + x] = fine[t];
    }
    SYNC;
    if (lane > 0) return;
    char2 all = fine[0];
    for (int t = 1; t < ALONG * ALONG; ++t) {
        all.x = fine[t].x < all.x ? fine[t].x : all.x;
        all.y = fine[t].y > all.y ? fine[t].y : all.y;
    }
    tiles[FINE_X * FINE_Y + coarse_y * COARSE_X + coarse_x] = all;
}

// Proximity to the nearest edge within a region of every view; twin: reference/image_objective/
// features.py. Defines: those of distance.h. A region is (x0, y0, x1, y1), the ends excluded.
#include "common/sizes.h"

#define TILES_X ((WIDTH + TILE - 1) / TILE)
// The edges (255) of a view within a region, whose right end is that of the columns. n_bytes: from
// the view on to the end of the stack.
typedef struct { __global const uchar *edges; int2 picture; int4 region; int n_bytes; } edge_source;
#include "common/distance.h"

static inline bytes edges_of(const edge_source *source, columns at, int y)
{
    const int2 picture = source->picture;
    const int place = y * WIDTH + at.x;
    if (y < source->region.y || y >= source->region.w) return (bytes)0;
#if LOT > 1
    if (place + LOT > source->n_bytes) { // a lot at the very end of the stack
        uchar last[LOT];
        for (int l = 0; l < LOT; ++l)
            last[l] = place + l < source->n_bytes ? source->edges[place + l] : 0;
        return vload16(0, last) & at.below;
    }
#endif
    return MAP_BYTES(source->edges + place) & at.below;
}

// maps: within the regions (silhouette, proximity), by `proximity` (REACH^2 + 2) at the exact
// squared distance to the nearest edge, whose last entry stands for all that is out of reach. One
// work-group per tile and view.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void edge_proximity(int2 picture, int reach, __global const char *restrict evidence,
                    __global const uchar *restrict edges,
                    __global const int4 *restrict regions,
                    __global const uchar *restrict proximity, __global uchar2 *restrict maps)
{
    __local gap_type gap[TILE_ROWS * ROOM + LOT], distance[ROOM + LOT];
    __local square_type squares[N_SQUARES];
    const int lane = get_local_id(0), view = get_global_id(1);
    const int left = get_group_id(0) % TILES_X * TILE, top = get_group_id(0) / TILES_X * TILE_ROWS;
    const int4 box = regions[view];
    const int2 low = max((int2)(left, top), box.xy);
    const int2 end = min((int2)(left + TILE, top + TILE_ROWS), box.zw);
    const int column_step = GROUP < TILE ? GROUP : TILE, row_step = GROUP / column_step;
    // A tile beside the region looks at nothing; it does not return, because PoCL 3 miscompiles
    // that.
    const bool inside = low.x < end.x && low.y < end.y;
    const int x0 = max(left - REACH, box.x), x1 = inside ? min(left + TILE + REACH, box.z) : x0;
    const size_t first = (size_t)view * HEIGHT * WIDTH;
    const edge_source source = {edges + first, picture, box,
                                ((int)get_global_size(1) - view) * HEIGHT * WIDTH};
    find_gaps(&source, reach, WIDTH, left, top, x0, x1, distance, gap, squares);
    for (int y = low.y + lane / TILE; y < (inside ? end.y : low.y); y += row_step)
        for (int x = left + lane % TILE * LOT; x < end.x; x += column_step * LOT) {
            square_type found[LOT];
            STORE_LOT(least_squares(reach, gap, squares, x - left, y - top), found);
            const size_t at = first + y * WIDTH + x;
            for (int l = 0; l < LOT; ++l)
                if (x + l >= low.x && x + l < end.x)
                    maps[at + l] = (uchar2)(evidence[at + l] > 0 ? 255 : 0, proximity[found[l]]);
        }
}

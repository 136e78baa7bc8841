// Projection of the surface voxels into every camera (Song et al. 2.3.2): silhouette and edge
// proximity. Twin: reference/reprojection.py. Defines: those of distance.h, for the proximity, that
// of pack.h, MARK (px) and UNKNOWN, the evidence of a pixel that says nothing. The maps are made
// tile by tile of TILE x TILE pixels, and only those near the silhouette at any cost.
#if !defined(CAMERA_FLOATS) || !defined(MARK) || !defined(PACK) || !defined(UNKNOWN)
#error "reconstruction/reprojection.cl needs CAMERA_FLOATS, MARK, PACK and UNKNOWN"
#endif
#include "common/camera.h"
#include "reconstruction/marks.h"
#include "reconstruction/packed_voxels.h"

#define TILES_X ((WIDTH + TILE - 1) / TILE)
// Where the boundary of a silhouette is, inside a picture of a height.
typedef struct { __global const uchar *map; int2 picture; int height; } edge_source;
#include "common/distance.h"

// Whole numbers at or below; operators only, see pack.h.
static inline vfloat whole_below(vfloat value)
{
    const vfloat whole = TO_FLOAT(TO_INT(value));
    return whole > value ? whole - 1.0f : whole;
}

// Covers the box of a voxel in a map, and marks it.
static inline void cover(int2 picture, int x0, int y0, int x1, int y1, __global uchar *map,
                         __global uchar *marks)
{
    for (int y = y0; y <= y1; ++y)
        for (int x = x0; x <= x1; ++x) map[y * WIDTH + x] = 255;
    for (int y = y0 / MARK; x0 <= x1 && y <= y1 / MARK && y0 <= y1; ++y)
        for (int x = x0 / MARK; x <= x1 / MARK; ++x) marks[y * MARKS_X + x] = 1;
}

// Every voxel covers the bounding box of its projected cube: all pixel centres inside, or the
// nearest pixel if there is none. All writers write the same, so their order does not matter.
// `extents` holds, per view, half the width and height of the box times depth, px m.
__kernel void splat(int2 picture, int3 grid, __global const float *restrict cameras,
                    __global const float2 *restrict extents,
                    __global const float *restrict geometry, // origin (3), voxel size
                    __global const int *restrict indices, __global const int *restrict n_surface,
                    __global uchar *restrict silhouette)
{
    const int view = get_global_id(1), n = *n_surface;
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    __global uchar *marks = silhouette + MARKS_PLACE + view * MARKS_X * MARKS_Y;
    __global uchar *map = silhouette + WIDTH + (size_t)view * WIDTH * HEIGHT;
    for (int first = get_global_id(0) * PACK; first < n; first += get_global_size(0) * PACK) {
#define VOXEL(l) indices[lane_index(first, 0x##l, n)]
        const voxel_place at = place_of(grid, PACK_OF(vint, VOXEL));
#undef VOXEL
        vfloat px, py;
        const vfloat depth = camera_project_pack(
            camera, geometry[0] + (TO_FLOAT(at.x) + 0.5f) * geometry[3],
            geometry[1] + (TO_FLOAT(at.y) + 0.5f) * geometry[3],
            geometry[2] + (TO_FLOAT(at.z) + 0.5f) * geometry[3], &px, &py);
        const vfloat half_x = extents[view].x / depth, half_y = extents[view].y / depth;
        const vfloat nearest_x = whole_below(px + 0.5f), nearest_y = whole_below(py + 0.5f);
        float seen[PACK], x0[PACK], y0[PACK], x1[PACK], y1[PACK];
        STORE_PACK(depth, seen);
        STORE_PACK(most(least(-whole_below(half_x - px), nearest_x), 0.0f), x0);
        STORE_PACK(most(least(-whole_below(half_y - py), nearest_y), 0.0f), y0);
        STORE_PACK(least(most(whole_below(px + half_x), nearest_x), camera[23] - 1.0f), x1);
        STORE_PACK(least(most(whole_below(py + half_y), nearest_y), camera[24] - 1.0f), y1);
        for (int l = 0; l < PACK; ++l)
            if (seen[l] > 0.0f)
                cover(picture, (int)x0[l], (int)y0[l], (int)x1[l], (int)y1[l], map, marks);
    }
}

// Does the silhouette touch anything that the pixels of the tile from (left, top) on can see?
static inline bool near_silhouette(int2 picture, int reach, int left, int top,
                                   __global const uchar *marks)
{
    const int x0 = max(left - REACH, 0) / MARK, y0 = max(top - REACH, 0) / MARK;
    const int x1 = min(left + TILE - 1 + REACH, WIDTH - 1) / MARK;
    const int y1 = min(top + TILE_ROWS - 1 + REACH, HEIGHT - 1) / MARK;
    int near = 0;
    for (int y = y0; y <= y1; ++y)
        for (int x = x0; x <= x1; ++x) near |= marks[y * MARKS_X + x];
    return near;
}

static inline int width_of(int2 picture) { return WIDTH; }

// The boundary lies inside the silhouette, with a 4-neighbour outside; the border of the picture is
// no boundary: nothing is known beyond it.
static inline bytes edges_of(const edge_source *source, columns at, int y)
{
    const int width = width_of(source->picture);
    const int height = source->height, row = y < 0 ? 0 : y < height ? y : height - 1;
    __global const uchar *here = source->map + row * width + at.x;
    const uchar top = row == 0 ? 255 : 0, bottom = row == height - 1 ? 255 : 0;
    const bytes inside = (MAP_BYTES(here - 1) | at.first) & (MAP_BYTES(here + 1) | at.last) &
                         (MAP_BYTES(here - width) | top) & (MAP_BYTES(here + width) | bottom);
    return MAP_BYTES(here) & ~inside & at.below & (uchar)(row == y ? 255 : 0);
}

// Maps of one tile: silhouette and, by `proximity` (up to REACH^2, then 0), the exact squared
// distance to the nearest boundary pixel. evidence: null, or the silhouette's lowest bit is turned
// where it is UNKNOWN. One work-group per tile and view.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void edge_proximity(int2 picture, int reach, __global const uchar *restrict silhouette,
                    __global const int2 *restrict sizes,
                    __global const uchar *restrict proximity,
                    __global const char *restrict evidence, __global uchar2 *restrict maps)
{
    __local gap_type gap[TILE_ROWS * ROOM + LOT], distance[ROOM + LOT];
    __local square_type squares[N_SQUARES];
    const int lane = get_local_id(0), view = get_global_id(1);
    const int tile_x = get_group_id(0) % TILES_X, tile_y = get_group_id(0) / TILES_X;
    const int left = tile_x * TILE, top = tile_y * TILE_ROWS;
    const int n_rows = min(TILE_ROWS, HEIGHT - top), n_columns = min(TILE, WIDTH - left);
    __global const uchar *map = silhouette + WIDTH + (size_t)view * WIDTH * HEIGHT;
    const size_t begin = (size_t)view * WIDTH * HEIGHT + top * WIDTH + left;
    __global uchar2 *out = maps + begin;
    const int column_step = GROUP < TILE ? GROUP : TILE, row_step = GROUP / column_step;
    // A tile from which no silhouette can be seen looks at nothing; it does not return, because
    // PoCL 3 miscompiles that.
    const bool near =
        near_silhouette(picture, reach, left, top,
                        silhouette + MARKS_PLACE + view * MARKS_X * MARKS_Y);
    const int2 size = sizes[view];
    const int x0 = max(left - REACH, 0);
    const int x1 = near ? min(left + TILE + REACH, size.x) : x0;
    const edge_source source = {map, picture, size.y};
    find_gaps(&source, reach, size.x, left, top, x0, x1, distance, gap, squares);
    for (int y = lane / TILE; y < n_rows; y += row_step)
        for (int x = lane % TILE * LOT; x < n_columns; x += column_step * LOT) {
            const int n = n_columns - x < LOT ? n_columns - x : LOT;
            __global uchar2 *place = out + y * WIDTH + x;
            if (near) {
                square_type found[LOT];
                STORE_LOT(least_squares(reach, gap, squares, x, y), found);
                __global const uchar *row = map + (top + y) * WIDTH + left + x;
                for (int l = 0; l < n; ++l) place[l] = (uchar2)(row[l], proximity[found[l]]);
            } else {
                for (int l = 0; l < n; ++l) place[l] = (uchar2)(0);
            }
            if (!evidence) continue;
            __global const char *own = evidence + begin + y * WIDTH + x;
            for (int l = 0; l < n; ++l)
                if (own[l] == UNKNOWN) place[l].x ^= 1;
        }
}

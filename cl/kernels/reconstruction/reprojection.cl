// Projection of the surface voxels into every camera (Song et al. 2.3.2): silhouette and edge
// proximity. Twin: reference/reprojection.py. Defines: WIDTH HEIGHT of the stack of maps, RADIUS of
// the proximity in pixels, NY NZ of the grid, TILE and MARK (px), LOT (1 or 16), GROUP, and that of
// pack.h. The maps are made tile by tile of TILE x TILE pixels, and only those near the silhouette
// at any cost.
#if !defined(CAMERA_FLOATS) || !defined(GROUP) || !defined(HEIGHT) || !defined(LOT) || \
    !defined(MARK) || !defined(NY) || !defined(NZ) || !defined(PACK) || !defined(RADIUS) || \
    !defined(TILE) || !defined(WIDTH)
#error "reconstruction/reprojection.cl needs CAMERA_FLOATS, GROUP, HEIGHT, LOT, MARK, NY, NZ, PACK, RADIUS, TILE and WIDTH"
#endif
#include "common/camera.h"
#include "common/pack.h"

#define TILES_X ((WIDTH + TILE - 1) / TILE)
// A mark says whether the silhouette touches MARK x MARK pixels. The marks lie behind the stack of
// silhouettes, which has a row more before and behind. Views are dimension 1 of the kernels.
#define MARKS_X ((WIDTH + MARK - 1) / MARK)
#define MARKS_Y ((HEIGHT + MARK - 1) / MARK)
#define MARKS_PLACE (((size_t)get_global_size(1) * HEIGHT + 2) * WIDTH)
// Columns that a tile's pixels can see.
#define SPAN (TILE + 2 * RADIUS)
// Rows that are looked at together, so that their pixels come together.
#define STRIP 8
// Strips of rows above or below a tile that its pixels can see.
#define STRIPS_BEYOND ((RADIUS + STRIP - 1) / STRIP)
// LOT neighbours in a row whose distances a CPU finds at once: their bytes, 255 where something is
// true of their columns, and their squared distances.
#if LOT == 1
typedef uchar bytes;
typedef ushort lot;
typedef uchar bytes_of_lot;
typedef ushort lot_anywhere;
#define COLUMNS(x) (x)
#define IN_BYTES(truth) ((uchar)((truth) ? 255 : 0))
#define STORE_LOT(values, place) (*(place) = (values))
#else
typedef uchar16 bytes;
typedef ushort16 lot;
typedef uchar16 bytes_of_lot __attribute__((aligned(1)));
typedef ushort16 lot_anywhere __attribute__((aligned(2)));
#define COLUMNS(x) ((x) + (int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))
#define IN_BYTES(truth) as_uchar16(convert_char16(truth))
#define STORE_LOT(values, place) vstore16(values, 0, place)
#endif
#define MAP_BYTES(place) (*(__global const bytes_of_lot *)(place))

// Whole numbers at or below; operators only, see pack.h.
inline vfloat whole_below(vfloat value)
{
    const vfloat whole = TO_FLOAT(TO_INT(value));
    return whole > value ? whole - 1.0f : whole;
}

// Covers the box of a voxel in a map, and marks it.
inline void cover(int x0, int y0, int x1, int y1, __global uchar *map, __global uchar *marks)
{
    for (int y = y0; y <= y1; ++y)
        for (int x = x0; x <= x1; ++x) map[y * WIDTH + x] = 255;
    for (int y = y0 / MARK; x0 <= x1 && y <= y1 / MARK && y0 <= y1; ++y)
        for (int x = x0 / MARK; x <= x1 / MARK; ++x) marks[y * MARKS_X + x] = 1;
}

// Every voxel covers the bounding box of its projected cube: all pixel centres inside, or the
// nearest pixel if there is none. All writers write the same, so their order does not matter.
// `extents` holds, per view, half the width and height of the box times depth, px m.
__kernel void splat(__global const float *restrict cameras, __global const float2 *restrict extents,
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
#define X(l) (VOXEL(l) / (NY * NZ) + 0.5f)
#define Y(l) (VOXEL(l) / NZ % NY + 0.5f)
#define Z(l) (VOXEL(l) % NZ + 0.5f)
        vfloat px, py;
        const vfloat depth = camera_project_pack(
            camera, geometry[0] + PACK_OF(vfloat, X) * geometry[3],
            geometry[1] + PACK_OF(vfloat, Y) * geometry[3],
            geometry[2] + PACK_OF(vfloat, Z) * geometry[3], &px, &py);
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
                cover((int)x0[l], (int)y0[l], (int)x1[l], (int)y1[l], map, marks);
    }
}

// Does the silhouette touch anything that the pixels of the tile from (left, top) on can see?
inline bool near_silhouette(int left, int top, __global const uchar *marks)
{
    const int x0 = max(left - RADIUS, 0) / MARK, y0 = max(top - RADIUS, 0) / MARK;
    const int x1 = min(left + TILE - 1 + RADIUS, WIDTH - 1) / MARK;
    const int y1 = min(top + TILE - 1 + RADIUS, HEIGHT - 1) / MARK;
    int near = 0;
    for (int y = y0; y <= y1; ++y)
        for (int x = x0; x <= x1; ++x) near |= marks[y * MARKS_X + x];
    return near;
}

// A lot of columns from x on in a picture: which are its first and last, which below `end`.
typedef struct { int x; bytes first, last, below; } columns;

inline columns columns_from(int x, int width, int end)
{
    const columns found = {x, IN_BYTES(COLUMNS(x) == 0), IN_BYTES(COLUMNS(x) == width - 1),
                           IN_BYTES(COLUMNS(x) < end)};
    return found;
}

// Is there a boundary (255) in these columns of row y, inside a picture of a height? The boundary
// lies inside the silhouette, with a 4-neighbour outside; the border of the picture is no boundary:
// nothing is known beyond it.
inline bytes boundary(__global const uchar *map, int height, columns at, int y)
{
    const int row = y < 0 ? 0 : y < height ? y : height - 1;
    __global const uchar *here = map + row * WIDTH + at.x;
    const uchar top = row == 0 ? 255 : 0, bottom = row == height - 1 ? 255 : 0;
    const bytes inside = (MAP_BYTES(here - 1) | at.first) & (MAP_BYTES(here + 1) | at.last) &
                         (MAP_BYTES(here - WIDTH) | top) & (MAP_BYTES(here + WIDTH) | bottom);
    return MAP_BYTES(here) & ~inside & at.below & (uchar)(row == y ? 255 : 0);
}

// STRIP rows from y on, up (step -1) or down (1), along columns x0 to x1: distances to the last
// boundary pixel met, RADIUS + 1 if it is out of reach. The rows' gaps, from `gap` on, become the
// less of what they were and these; a null pointer stands for rows outside of the tile. Beyond x1
// a lot looks at another row's gaps, and leaves them as they are.
inline void pass_strip(__global const uchar *map, int2 size, int x0, int x1, int y, int step,
                       __local uchar *distance, __local uchar *gap)
{
    for (int c = get_local_id(0) * LOT; c < x1 - x0; c += GROUP * LOT) {
        const columns at = columns_from(x0 + c, size.x, x1);
        bytes edges[STRIP];
#pragma unroll
        for (int r = 0; r < STRIP; ++r) edges[r] = boundary(map, size.y, at, y + r * step);
        __local bytes_of_lot *reached = (__local bytes_of_lot *)(distance + c);
        bytes last = *reached;
#pragma unroll
        for (int r = 0; r < STRIP; ++r) {
            const bytes next = last <= (uchar)RADIUS ? last + (uchar)1 : last;
            last = edges[r] > (uchar)0 ? (bytes)0 : next;
            if (gap) {
                __local bytes_of_lot *place = (__local bytes_of_lot *)(gap + r * step * SPAN + c);
                const bytes old = *place;
                *place = last < old ? last : old;
            }
        }
        *reached = last;
    }
}

// Maps of one tile: silhouette and, by `proximity` (up to RADIUS^2, then 0), the exact squared
// distance to the nearest boundary pixel. One work-group per tile and view.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void edge_proximity(__global const uchar *restrict silhouette, __global const int2 *restrict sizes,
                    __global const uchar *restrict proximity, __global uchar2 *restrict maps)
{
    __local uchar gap[TILE * SPAN + LOT], distance[SPAN + LOT];
    __local ushort squares[TILE * SPAN + LOT];
    const int lane = get_local_id(0), view = get_global_id(1);
    const int tile_x = get_group_id(0) % TILES_X, tile_y = get_group_id(0) / TILES_X;
    const int left = tile_x * TILE, top = tile_y * TILE;
    const int n_rows = min(TILE, HEIGHT - top), n_columns = min(TILE, WIDTH - left);
    __global const uchar *map = silhouette + WIDTH + (size_t)view * WIDTH * HEIGHT;
    __global uchar2 *out = maps + (size_t)view * WIDTH * HEIGHT + top * WIDTH + left;
    const int column_step = GROUP < TILE ? GROUP : TILE, row_step = GROUP / column_step;
    // A tile from which no silhouette can be seen looks at nothing; it does not return, because
    // PoCL 3 miscompiles that.
    const bool near =
        near_silhouette(left, top, silhouette + MARKS_PLACE + view * MARKS_X * MARKS_Y);
    const int2 size = sizes[view];
    const int x0 = max(left - RADIUS, 0);
    const int x1 = near ? min(left + TILE + RADIUS, size.x) : x0;
    __local uchar *seen = gap + x0 - (left - RADIUS);
    // Items keep to their own columns until the whole tile is known.
    for (int c = lane; c < (near ? TILE * SPAN : 0); c += GROUP) gap[c] = RADIUS + 1;
    for (int c = lane; c < SPAN + LOT; c += GROUP) distance[c] = RADIUS + 1;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int strip = -STRIPS_BEYOND; strip < TILE / STRIP; ++strip)
        pass_strip(map, size, x0, x1, top + strip * STRIP, 1, distance,
                   strip < 0 ? 0 : seen + strip * STRIP * SPAN);
    for (int c = lane; c < SPAN + LOT; c += GROUP) distance[c] = RADIUS + 1;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int strip = -STRIPS_BEYOND; strip < TILE / STRIP; ++strip)
        pass_strip(map, size, x0, x1, top + TILE - 1 - strip * STRIP, -1, distance,
                   strip < 0 ? 0 : seen + (TILE - 1 - strip * STRIP) * SPAN);
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int c = lane; c < (near ? TILE * SPAN : 0); c += GROUP)
        squares[c] = (ushort)gap[c] * gap[c];
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int y = lane / TILE; y < n_rows; y += row_step)
        for (int x = lane % TILE * LOT; x < n_columns; x += column_step * LOT) {
            const int n = n_columns - x < LOT ? n_columns - x : LOT;
            __global uchar2 *place = out + y * WIDTH + x;
            if (!near) {
                for (int l = 0; l < n; ++l) place[l] = (uchar2)(0);
                continue;
            }
            // Beyond the tile's end a lot looks at another row's gaps, and says nothing.
            lot squared = RADIUS * RADIUS + 1;
#pragma unroll
            for (int dx = -RADIUS; dx <= RADIUS; ++dx) {
                __local const ushort *here = squares + y * SPAN + x + dx + RADIUS;
                const lot there = *(__local const lot_anywhere *)here + (ushort)(dx * dx);
                squared = there < squared ? there : squared;
            }
            ushort found[LOT];
            STORE_LOT(squared, found);
            __global const uchar *row = map + (top + y) * WIDTH + left + x;
            for (int l = 0; l < n; ++l) place[l] = (uchar2)(row[l], proximity[found[l]]);
        }
}

// Exact squared Euclidean distance to the nearest edge (Saito & Toriwaki 1994), tile by tile: along
// the columns, up and down, then the least of gap^2 + dx^2 along the rows. Counterpart:
// psfs/common/edge_distance.py; twin: psfs/reference/reprojection.py.
// Where CHESSBOARD is defined as 1, instead the chessboard distance, the greater of |dx| and |dy|.
// Defines: MOST_REACH; TILE columns and TILE_ROWS rows of a tile; LOT, 1 or 16; GROUP. REACH, px,
// beyond which all distances are as one, is an argument, for GPUs a define as well, see sizes.h.
// What includes this says where edges are, by a type `edge_source` and the function `edges_of`.
#if !defined(GROUP) || !defined(LOT) || !defined(MOST_REACH) || !defined(TILE) || \
    !defined(TILE_ROWS)
#error "common/distance.h needs GROUP, LOT, MOST_REACH, TILE and TILE_ROWS"
#endif
#ifndef REACH
#define REACH reach
#endif
#include "common/inlined.h"

// The squared distance of an edge by the squares of its distances along the columns and rows.
#if CHESSBOARD
#define JOINED(a, b) max(a, (lot)(b))
#else
#define JOINED(a, b) ((a) + (b))
#endif
// Columns that a tile's pixels can see, and room for them.
#define SPAN (TILE + 2 * REACH)
#define ROOM (TILE + 2 * MOST_REACH)
// Rows that are looked at together, so that their pixels come together.
#define STRIP 8
#if TILE_ROWS % STRIP != 0
#error "common/distance.h: TILE_ROWS must be a multiple of 8"
#endif
// Strips of rows above or below a tile that its pixels can see.
#define STRIPS_BEYOND ((REACH + STRIP - 1) / STRIP)
// LOT neighbours in a row whose distances a CPU finds at once: their bytes, 255 where something is
// true of their columns; their gaps along the columns; their squared distances.
#if LOT == 1
#define LOT_OF(type) type
#define COLUMNS(x) (x)
#define IN_BYTES(truth) ((uchar)((truth) ? 255 : 0))
#define STORE_LOT(values, place) (*(place) = (values))
#else
#define LOT_OF(type) type##16
#define COLUMNS(x) ((x) + (int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))
#define IN_BYTES(truth) as_uchar16(convert_char16(truth))
#define STORE_LOT(values, place) vstore16(values, 0, place)
#endif
typedef LOT_OF(uchar) bytes;
typedef LOT_OF(uchar) bytes_of_lot __attribute__((aligned(1)));
#define MAP_BYTES(place) (*(__global const bytes_of_lot *)(place))

#if MOST_REACH <= 180 // (REACH + 1)^2 + REACH^2 fits into 16 bits
typedef uchar gap_type;
typedef ushort square_type;
typedef LOT_OF(uchar) gaps;
typedef LOT_OF(uchar) gaps_anywhere __attribute__((aligned(1)));
typedef LOT_OF(ushort) lot;
typedef LOT_OF(ushort) lot_anywhere __attribute__((aligned(2)));
#define GAPS_OF(edges) (edges)
#define N_SQUARES (TILE_ROWS * ROOM + LOT)
#define SQUARES(squares, distances, at) (*(__local const lot_anywhere *)((squares) + (at)))
#else // where gaps take two bytes there is no room to keep their squares
typedef ushort gap_type;
typedef uint square_type;
typedef LOT_OF(ushort) gaps;
typedef LOT_OF(ushort) gaps_anywhere __attribute__((aligned(2)));
typedef LOT_OF(uint) lot;
#if LOT == 1
#define GAPS_OF(edges) ((ushort)(edges))
#define WIDE(gaps) ((uint)(gaps))
#else
#define GAPS_OF(edges) convert_ushort16(edges)
#define WIDE(gaps) convert_uint16(gaps)
#endif
#define N_SQUARES 1
#define SQUARES(squares, distances, at) squared_gaps((distances) + (at))
INLINED lot squared_gaps(__local const gap_type *place)
{
    const lot gap = WIDE(*(__local const gaps_anywhere *)place);
    return gap * gap;
}
#endif

// A lot of columns from x on in a picture: which are its first and last, which below `end`.
typedef struct { int x; bytes first, last, below; } columns;

static inline columns columns_from(int x, int width, int end)
{
    const columns found = {x, IN_BYTES(COLUMNS(x) == 0), IN_BYTES(COLUMNS(x) == width - 1),
                           IN_BYTES(COLUMNS(x) < end)};
    return found;
}

// 255 where there is an edge in these columns of row y, which may lie outside of the picture.
static inline bytes edges_of(const edge_source *source, columns at, int y);

// STRIP rows from y on, up (step -1) or down (1), along columns x0 to x1: distances to the last
// edge met, REACH + 1 if it is out of reach. The rows' gaps, from `gap` on, become the less of what
// they were and these; a null pointer stands for rows outside of the tile. Beyond x1 a lot looks at
// another row's gaps, and leaves them as they are.
INLINED void pass_strip(const edge_source *source, int reach, int width, int x0, int x1, int y,
                        int step, __local gap_type *distance, __local gap_type *gap)
{
    for (int c = get_local_id(0) * LOT; c < x1 - x0; c += GROUP * LOT) {
        const columns at = columns_from(x0 + c, width, x1);
        bytes edges[STRIP];
#pragma unroll
        for (int r = 0; r < STRIP; ++r) edges[r] = edges_of(source, at, y + r * step);
        __local gaps_anywhere *reached = (__local gaps_anywhere *)(distance + c);
        gaps last = *reached;
#pragma unroll
        for (int r = 0; r < STRIP; ++r) {
            const gaps next = last <= (gap_type)REACH ? last + (gap_type)1 : last;
            last = GAPS_OF(edges[r]) > (gap_type)0 ? (gaps)0 : next;
            if (gap) {
                __local gaps_anywhere *place = (__local gaps_anywhere *)(gap + r * step * SPAN + c);
                const gaps old = *place;
                *place = last < old ? last : old;
            }
        }
        *reached = last;
    }
}

// The gaps of the tile from (left, top) on, TILE_ROWS x SPAN, and, where there is room, their
// squares: from the edges in columns x0 to x1 of a picture of this width; nothing where these are
// the same. distance: SPAN. All arrays have room for a LOT more.
INLINED void find_gaps(const edge_source *source, int reach, int width, int left, int top, int x0,
                       int x1, __local gap_type *distance, __local gap_type *gap,
                       __local square_type *squares)
{
    const int lane = get_local_id(0), n = x1 > x0 ? TILE_ROWS * SPAN : 0;
    __local gap_type *seen = gap + x0 - (left - REACH);
    // Items keep to their own columns until the whole tile is known.
    for (int c = lane; c < n; c += GROUP) gap[c] = REACH + 1;
    for (int c = lane; c < SPAN + LOT; c += GROUP) distance[c] = REACH + 1;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int strip = -STRIPS_BEYOND; strip < TILE_ROWS / STRIP; ++strip)
        pass_strip(source, reach, width, x0, x1, top + strip * STRIP, 1, distance,
                   strip < 0 ? 0 : seen + strip * STRIP * SPAN);
    for (int c = lane; c < SPAN + LOT; c += GROUP) distance[c] = REACH + 1;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int strip = -STRIPS_BEYOND; strip < TILE_ROWS / STRIP; ++strip)
        pass_strip(source, reach, width, x0, x1, top + TILE_ROWS - 1 - strip * STRIP, -1, distance,
                   strip < 0 ? 0 : seen + (TILE_ROWS - 1 - strip * STRIP) * SPAN);
    barrier(CLK_LOCAL_MEM_FENCE);
#if MOST_REACH <= 180
    for (int c = lane; c < n; c += GROUP) squares[c] = (ushort)gap[c] * gap[c];
    barrier(CLK_LOCAL_MEM_FENCE);
#endif
}

// Squared distances of the LOT pixels from (x, y) of the tile on, REACH^2 + 1 out of reach. Beyond
// the tile's end a lot looks at another row's gaps, and says nothing.
INLINED lot least_squares(int reach, __local const gap_type *gap,
                          __local const square_type *squares, int x, int y)
{
    lot least = (square_type)(REACH * REACH + 1);
#if MOST_REACH <= 180
#pragma unroll
#endif
    for (int dx = -REACH; dx <= REACH; ++dx) {
        const lot there =
            JOINED(SQUARES(squares, gap, y * SPAN + x + dx + REACH), (square_type)(dx * dx));
        least = there < least ? there : least;
    }
    return least;
}

// Exact Euclidean distance to the nearest edge within a region of every view, in two passes (Saito
// & Toriwaki 1994), as a table of proximity says it; twin: reference/image_objective/features.py.
// Defines: WIDTH, HEIGHT of the stack of views; REACH, the largest distance that the table tells
// from infinity, px. A region is (x0, y0, x1, y1), the ends excluded. `gaps` has PITCH columns,
// REACH of them left of the picture and REACH + STRIP right of it, which spare the second pass its
// bounds.
#if !defined(HEIGHT) || !defined(REACH) || !defined(STRIP) || !defined(WIDTH)
#error "image/distance.cl needs HEIGHT, REACH, STRIP and WIDTH"
#endif
#if STRIP != 8
#error "distance.cl: a strip is a vector of 8 numbers"
#endif
#define PITCH (WIDTH + 2 * REACH + STRIP)

#if REACH <= 180 // (REACH + 1)^2 + REACH^2 fits into 16 bits
typedef ushort8 Squares;
#define convert_squares(gaps) (gaps)
#else
typedef uint8 Squares;
#define convert_squares convert_uint8
#endif

// Distance along the column to the nearest edge, REACH + 1 if there is none in reach or the column
// lies beside the region; one work-item per column and view.
__kernel void column_gaps(__global const uchar *restrict edges,
                          __global const int4 *restrict regions, __global ushort *restrict gaps)
{
    const int view = get_global_id(1);
    const int4 box = regions[view];
    const int x = box.x - REACH + (int)get_global_id(0);
    if (box.z == 0 || x >= box.z + REACH + STRIP) return;
    const bool inside = x >= box.x && x < box.z;
    __global const uchar *edge = edges + (size_t)view * HEIGHT * WIDTH + x;
    __global ushort *column = gaps + (size_t)view * HEIGHT * PITCH + REACH + x;
    int gap = REACH + 1;
    for (int y = box.y; y < box.w; ++y) {
        gap = inside && edge[y * WIDTH] ? 0 : min(gap + 1, REACH + 1);
        column[y * PITCH] = gap;
    }
    for (int y = box.w - 1; inside && y >= box.y; --y) {
        gap = min(gap + 1, (int)column[y * PITCH]);
        column[y * PITCH] = gap;
    }
}

// The least of gap^2 + dx^2 along the row; a work-item makes STRIP pixels. maps: (silhouette,
// proximity) by `proximity` (REACH^2 + 2), whose last entry stands for all that is out of reach.
__kernel void nearest_edge(__global const char *restrict evidence,
                           __global const ushort *restrict gaps,
                           __global const int4 *restrict regions,
                           __global const uchar *restrict proximity,
                           __global uchar2 *restrict maps)
{
    const int view = get_global_id(2);
    const int4 box = regions[view];
    const int x = box.x + STRIP * get_global_id(0), y = box.y + get_global_id(1);
    if (x >= box.z || y >= box.w) return;
    __global const ushort *row = gaps + ((size_t)view * HEIGHT + y) * PITCH + REACH + x;
    Squares least = (Squares)(REACH * REACH + 1);
    for (int dx = -REACH; dx <= REACH; ++dx) {
        const Squares gap = convert_squares(vload8(0, row + dx));
        const Squares squared = gap * gap + (Squares)(dx * dx);
        least = squared < least ? squared : least;
    }
    uint squared[STRIP];
    vstore8(convert_uint8(least), 0, squared);
    const size_t at = ((size_t)view * HEIGHT + y) * WIDTH + x;
    for (int i = 0; i < min(STRIP, box.z - x); ++i)
        maps[at + i] = (uchar2)(evidence[at + i] > 0 ? 255 : 0, proximity[squared[i]]);
}

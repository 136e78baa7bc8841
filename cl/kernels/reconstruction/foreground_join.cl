// Joins to the silhouettes of the voxels what the pictures show of the foreground beside them: one
// camera that takes a limb for background carves it away in all. Twin: reference/reprojection.py.
// Defines: MARK, px, edge of a cell, 8; GROUP. Views are dimension 1 of the kernels.
#if !defined(GROUP) || !defined(MARK)
#error "reconstruction/foreground_join.cl needs GROUP and MARK"
#endif
#if MARK != 8
#error "a cell's 8 x 8 pixels are the bits of a ulong"
#endif

#include "reconstruction/marks.h"

// Cells (V, 4) int x0, y0, x1, y1, the ends excluded, around the cells that the voxels' silhouette
// touches, larger by `sides` percent of the silhouette's height at both sides and above and by
// `below` percent below; empty where there is none. One work-group per view.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void person_box(int2 picture, int sides, int below, __global const uchar *restrict silhouette,
                __global int4 *restrict boxes)
{
    __local int4 found[GROUP];
    const int lane = get_local_id(0), view = get_global_id(1);
    __global const uchar *marks = silhouette + MARKS_PLACE + view * MARKS_X * MARKS_Y;
    int4 box = (int4)(MARKS_X, MARKS_Y, 0, 0);
    for (int cell = lane; cell < MARKS_X * MARKS_Y; cell += GROUP)
        if (marks[cell]) {
            const int x = cell % MARKS_X, y = cell / MARKS_X;
            box = (int4)(min(box.x, x), min(box.y, y), max(box.z, x + 1), max(box.w, y + 1));
        }
    found[lane] = box;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int half_size = GROUP / 2; half_size > 0; half_size /= 2) {
        if (lane < half_size) {
            const int4 a = found[lane], b = found[lane + half_size];
            found[lane] = (int4)(min(a.x, b.x), min(a.y, b.y), max(a.z, b.z), max(a.w, b.w));
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (lane == 0) {
        const int4 whole = found[0];
        const int height = max(whole.w - whole.y, 0);
        const int aside = sides * height / 100, down = below * height / 100;
        boxes[view] = height == 0 ? (int4)(0)
                                  : (int4)(max(whole.x - aside, 0), max(whole.y - aside, 0),
                                           min(whole.z + aside, MARKS_X),
                                           min(whole.w + down, MARKS_Y));
    }
}

// Which pixels of each cell of the boxes are foreground: (V, MARKS_Y, MARKS_X) with bit 8 y + x of
// a cell's pixel (x, y); 0 outside of the boxes.
__kernel void foreground_bits(int2 picture, __global const char *restrict evidence,
                              __global const int4 *restrict boxes, __global ulong *restrict bits)
{
    const int cell = get_global_id(0), view = get_global_id(1);
    if (cell >= MARKS_X * MARKS_Y) return;
    const int x = cell % MARKS_X, y = cell / MARKS_X;
    const int4 box = boxes[view];
    ulong shown = 0;
    if (x >= box.x && x < box.z && y >= box.y && y < box.w) {
        const int n_columns = min(MARK, WIDTH - MARK * x), n_rows = min(MARK, HEIGHT - MARK * y);
        __global const char *first =
            evidence + ((size_t)view * HEIGHT + MARK * y) * WIDTH + MARK * x;
        for (int row = 0; row < n_rows; ++row)
            for (int column = 0; column < n_columns; ++column)
                if (first[row * WIDTH + column] > 0) shown |= 1UL << (MARK * row + column);
    }
    bits[view * MARKS_X * MARKS_Y + cell] = shown;
}

// Adds the foreground of each cell that has, with its neighbours, `least` pixels of it.
__kernel void join_foreground(int2 picture, int least, __global const int4 *restrict boxes,
                              __global const ulong *restrict bits,
                              __global uchar *restrict silhouette)
{
    const int cell = get_global_id(0), view = get_global_id(1);
    if (cell >= MARKS_X * MARKS_Y) return;
    const int x = cell % MARKS_X, y = cell / MARKS_X;
    const int4 box = boxes[view];
    if (x < box.x || x >= box.z || y < box.y || y >= box.w) return;
    bits += view * MARKS_X * MARKS_Y;
    const ulong shown = bits[cell];
    if (shown == 0) return;
    int n = 0;
    for (int row = max(y - 1, 0); row <= min(y + 1, MARKS_Y - 1); ++row)
        for (int column = max(x - 1, 0); column <= min(x + 1, MARKS_X - 1); ++column)
            n += (int)popcount(bits[row * MARKS_X + column]);
    if (n < least) return;
    __global uchar *first =
        silhouette + WIDTH + ((size_t)view * HEIGHT + MARK * y) * WIDTH + MARK * x;
    for (int row = 0; row < MARK; ++row)
        for (int column = 0; column < MARK; ++column)
            if (shown >> (MARK * row + column) & 1) first[row * WIDTH + column] = 255;
    silhouette[MARKS_PLACE + view * MARKS_X * MARKS_Y + cell] = 1;
}

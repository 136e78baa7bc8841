// Exact Euclidean distance to the nearest edge within a region of every view, in two passes
// (Saito & Toriwaki 1994), as a table of proximity says it; twin: reference/features.py. Defines:
// WIDTH, HEIGHT of the stack of views; REACH, the largest distance that the table tells from
// infinity, px. A region is (x0, y0, x1, y1), the ends excluded.

// Distance along the column to the nearest edge, REACH + 1 if there is none in reach; one
// work-item per column and view.
__kernel void column_gaps(__global const uchar *restrict edges,
                          __global const int4 *restrict regions, __global ushort *restrict gaps)
{
    const int view = get_global_id(1);
    const int4 box = regions[view];
    const int x = box.x + get_global_id(0);
    if (x >= box.z) return;
    const size_t column = (size_t)view * HEIGHT * WIDTH + x;
    int gap = REACH + 1;
    for (int y = box.y; y < box.w; ++y) {
        gap = edges[column + y * WIDTH] ? 0 : min(gap + 1, REACH + 1);
        gaps[column + y * WIDTH] = gap;
    }
    for (int y = box.w - 1; y >= box.y; --y) {
        gap = min(gap + 1, (int)gaps[column + y * WIDTH]);
        gaps[column + y * WIDTH] = gap;
    }
}

// Looks left and right only as far as a nearer edge can lie. maps: (silhouette, proximity) by
// `proximity` (REACH^2 + 2), whose last entry stands for all that is out of reach.
__kernel void nearest_edge(__global const char *restrict evidence,
                           __global const ushort *restrict gaps,
                           __global const int4 *restrict regions,
                           __global const uchar *restrict proximity,
                           __global uchar2 *restrict maps)
{
    const int view = get_global_id(2);
    const int4 box = regions[view];
    const int x = box.x + get_global_id(0), y = box.y + get_global_id(1);
    if (x >= box.z || y >= box.w) return;
    const size_t row = ((size_t)view * HEIGHT + y) * WIDTH;
    int squared = min((int)gaps[row + x] * gaps[row + x], REACH * REACH + 1);
    for (int dx = 1; dx * dx < squared; ++dx) {
        const int left = gaps[row + max(x - dx, box.x)];
        const int right = gaps[row + min(x + dx, box.z - 1)];
        const int gap = min(left, right);
        squared = min(squared, gap * gap + dx * dx);
    }
    maps[row + x] = (uchar2)(evidence[row + x] > 0 ? 255 : 0, proximity[squared]);
}

// What image objectives compare a body with: region of interest and edges per view (Rymut 2016,
// 2.1); twin: reference/features.py. Defines: WIDTH, HEIGHT of the stack of views; CELL, FILLED,
// MARGIN for `region`; DILATION (px) and THRESHOLD2 for the edges.
// A region is (x0, y0, x1, y1), the ends excluded; work-item (0, 0) stands at its corner.

inline int4 joined(int4 a, int4 b)
{
    return (int4)(min(a.xy, b.xy), max(a.zw, b.zw));
}

// Bounding box of the cells of CELL x CELL pixels that hold at least FILLED pixels of the
// silhouette, so that no speck counts, MARGIN pixels larger within the picture; all 0 if there is
// none. One work-group per view.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void region(__global const char *restrict evidence, __global const int2 *restrict sizes,
            __global int4 *restrict regions)
{
    __local int4 scratch[GROUP];
    const int view = get_group_id(0), lane = get_local_id(0);
    const int columns = (WIDTH + CELL - 1) / CELL, rows = (HEIGHT + CELL - 1) / CELL;
    int4 box = (int4)(WIDTH, HEIGHT, 0, 0);
    for (int cell = lane; cell < rows * columns; cell += GROUP) {
        const int x0 = cell % columns * CELL, y0 = cell / columns * CELL;
        const int x1 = min(x0 + CELL, WIDTH), y1 = min(y0 + CELL, HEIGHT);
        int count = 0;
        for (int y = y0; y < y1; ++y)
            for (int x = x0; x < x1; ++x)
                count += evidence[((size_t)view * HEIGHT + y) * WIDTH + x] > 0;
        if (count >= FILLED) box = joined(box, (int4)(x0, y0, x1, y1));
    }
    scratch[lane] = box;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int half_size = GROUP / 2; half_size > 0; half_size /= 2) {
        if (lane < half_size) scratch[lane] = joined(scratch[lane], scratch[lane + half_size]);
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (lane == 0) {
        box = scratch[0];
        const int2 low = max(box.xy - MARGIN, 0), high = min(box.zw + MARGIN, sizes[view]);
        regions[view] = box.z > 0 ? (int4)(low, high) : (int4)(0);
    }
}

inline int grey(__global const uchar *colour)
{
    return (29 * colour[0] + 150 * colour[1] + 77 * colour[2] + 128) >> 8;
}

// A Gaussian of 3x3 pixels, then Sobel's derivative, are one filter of 5x5 pixels that separates
// into (1 4 6 4 1) along one axis and (-1 -2 0 2 1) along the other. This is its part along the
// rows: derivative and smoothed grey, for the region and two rows above and below it. Pixels
// beyond the picture repeat its border.
__kernel void gradient_rows(__global const uchar *restrict images,
                            __global const int2 *restrict sizes,
                            __global const int4 *restrict regions,
                            __global short2 *restrict rows)
{
    const int view = get_global_id(2);
    const int4 box = regions[view];
    const int2 size = sizes[view];
    const int x = box.x + get_global_id(0), y = box.y - 2 + get_global_id(1);
    if (x >= box.z || y < 0 || y >= min(box.w + 2, size.y)) return;
    const size_t row = ((size_t)view * HEIGHT + y) * WIDTH;
    int taps[5];
    for (int i = 0; i < 5; ++i)
        taps[i] = grey(images + 3 * (row + min(max(x + i - 2, 0), size.x - 1)));
    rows[row + x] = (short2)(taps[4] - taps[0] + 2 * (taps[3] - taps[1]),
                             taps[0] + taps[4] + 4 * (taps[1] + taps[3]) + 6 * taps[2]);
}

// Is there silhouette within DILATION pixels along x and y?
inline bool near_silhouette(__global const char *restrict evidence, int2 size, int view, int x,
                            int y)
{
    int found = 0;
    for (int v = max(y - DILATION, 0); v <= min(y + DILATION, size.y - 1); ++v)
        for (int u = max(x - DILATION, 0); u <= min(x + DILATION, size.x - 1); ++u)
            found |= evidence[((size_t)view * HEIGHT + v) * WIDTH + u] > 0;
    return found;
}

// 255 where the gradient's squared magnitude (Rymut 2016 eq. 2.8) is at least THRESHOLD2 near
// the silhouette.
__kernel void gradient_edges(__global const short2 *restrict rows,
                             __global const char *restrict evidence,
                             __global const int2 *restrict sizes,
                             __global const int4 *restrict regions,
                             __global uchar *restrict edges)
{
    const int view = get_global_id(2);
    const int4 box = regions[view];
    const int2 size = sizes[view];
    const int x = box.x + get_global_id(0), y = box.y + get_global_id(1);
    if (x >= box.z || y >= box.w) return;
    int2 taps[5];
    for (int i = 0; i < 5; ++i) {
        const int v = min(max(y + i - 2, 0), size.y - 1);
        taps[i] = convert_int2(rows[((size_t)view * HEIGHT + v) * WIDTH + x]);
    }
    const int gx = taps[0].x + taps[4].x + 4 * (taps[1].x + taps[3].x) + 6 * taps[2].x;
    const int gy = taps[4].y - taps[0].y + 2 * (taps[3].y - taps[1].y);
    bool edge = gx * gx + gy * gy >= THRESHOLD2;
    if (edge) edge = near_silhouette(evidence, size, view, x, y);
    edges[((size_t)view * HEIGHT + y) * WIDTH + x] = edge ? 255 : 0;
}

// 255 where `candidates`, edges found elsewhere, lie near the silhouette.
__kernel void masked_edges(__global const uchar *restrict candidates,
                           __global const char *restrict evidence,
                           __global const int2 *restrict sizes,
                           __global const int4 *restrict regions, __global uchar *restrict edges)
{
    const int view = get_global_id(2);
    const int4 box = regions[view];
    const int x = box.x + get_global_id(0), y = box.y + get_global_id(1);
    if (x >= box.z || y >= box.w) return;
    const size_t at = ((size_t)view * HEIGHT + y) * WIDTH + x;
    const bool edge = candidates[at] && near_silhouette(evidence, sizes[view], view, x, y);
    edges[at] = edge ? 255 : 0;
}

// 255 on the silhouette's boundary: inside, with a 4-neighbour outside. The border of the picture
// is no boundary.
__kernel void outline_edges(__global const char *restrict evidence,
                            __global const int2 *restrict sizes,
                            __global const int4 *restrict regions, __global uchar *restrict edges)
{
    const int view = get_global_id(2);
    const int4 box = regions[view];
    const int2 size = sizes[view];
    const int x = box.x + get_global_id(0), y = box.y + get_global_id(1);
    if (x >= box.z || y >= box.w) return;
    const size_t at = ((size_t)view * HEIGHT + y) * WIDTH + x;
    __global const char *here = evidence + at;
    const bool inside = (x == 0 || here[-1] > 0) && (x == size.x - 1 || here[1] > 0) &&
                        (y == 0 || here[-WIDTH] > 0) && (y == size.y - 1 || here[WIDTH] > 0);
    edges[at] = here[0] > 0 && !inside ? 255 : 0;
}

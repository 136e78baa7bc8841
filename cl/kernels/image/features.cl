// What image objectives compare a body with: region of interest and edges per view (Rymut 2016,
// 2.1); twin: reference/image_objective/features.py. Defines: CELL, FILLED and BLOBS for
// `region`; STRIP; GROUP. A region is (x0, y0, x1, y1), the ends excluded; work-item (0, 0) stands
// at its corner.
#if !defined(BLOBS) || !defined(CELL) || !defined(FILLED) || !defined(GROUP) || !defined(STRIP)
#error "image/features.cl needs BLOBS, CELL, FILLED, GROUP and STRIP"
#endif
#include "common/inlined.h"
#include "common/sizes.h"

// Length of the gradients' rows.
#define PITCH (WIDTH + STRIP)

// Pixels of a row that one work-item of the costly kernels makes. Vectors are explicit: PoCL makes
// none of loops whose lengths are known to the device only.
#if STRIP != 8
#error "features.cl: a strip is a vector of 8 numbers"
#endif

static inline int4 joined(int4 a, int4 b)
{
    return (int4)(min(a.x, b.x), min(a.y, b.y), max(a.z, b.z), max(a.w, b.w));
}

#define COLUMNS ((WIDTH + CELL - 1) / CELL)
#define ROWS ((HEIGHT + CELL - 1) / CELL)

// The pixels of a cell (x0, y0, x1, y1), the ends excluded.
static inline int4 cell_box(int2 picture, int cell)
{
    const int x = cell % COLUMNS * CELL, y = cell / COLUMNS * CELL;
    return (int4)(x, y, min(x + CELL, WIDTH), min(y + CELL, HEIGHT));
}

// How many of them are of the view's silhouette.
static inline int silhouette_pixels(int2 picture, __global const char *evidence, int view, int4 box)
{
    int count = 0;
    for (int y = box.y; y < box.w; ++y)
        for (int x = box.x; x < box.z; ++x)
            count += evidence[((size_t)view * HEIGHT + y) * WIDTH + x] > 0;
    return count;
}

// The region of a view whose items have these boxes: what they enclose, `margin` pixels larger
// within the picture; all 0 if there is none.
INLINED void enclose(int4 box, int margin, __local int4 *scratch, int2 size, __global int4 *region)
{
    const int lane = get_local_id(0);
    scratch[lane] = box;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int half_size = GROUP / 2; half_size > 0; half_size /= 2) {
        if (lane < half_size) scratch[lane] = joined(scratch[lane], scratch[lane + half_size]);
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (lane == 0) {
        const int4 all = scratch[0];
        const int2 low = max(all.xy - margin, (int2)(0)), high = min(all.zw + margin, size);
        *region = all.z > 0 ? (int4)(low.x, low.y, high.x, high.y) : (int4)(0);
    }
}

// Bounding box of the cells of CELL x CELL pixels that hold at least FILLED pixels of the
// silhouette, so that no speck counts, `margin` pixels larger within the picture; all 0 if there is
// none. One work-group per view.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void region(int2 picture, int margin, __global const char *restrict evidence,
            __global const int2 *restrict sizes, __global int4 *restrict regions)
{
    __local int4 scratch[GROUP];
    const int view = get_group_id(0), lane = get_local_id(0);
    int4 box = (int4)(WIDTH, HEIGHT, 0, 0);
    for (int cell = lane; cell < ROWS * COLUMNS; cell += GROUP) {
        const int4 own = cell_box(picture, cell);
        if (silhouette_pixels(picture, evidence, view, own) >= FILLED) box = joined(box, own);
    }
    enclose(box, margin, scratch, sizes[view], regions + view);
}

// The first cell of the blob that a cell is known to belong to.
static inline int first_of(volatile __global const int *blobs, int cell)
{
    int next = blobs[cell];
    while (next != cell) {
        cell = next;
        next = blobs[cell];
    }
    return cell;
}

// Makes one blob of those of two cells (union by the lower number: Komura 2015).
static inline void unite(volatile __global int *blobs, int a, int b)
{
    a = first_of(blobs, a);
    b = first_of(blobs, b);
    while (a != b) {
        const int high = max(a, b), low = min(a, b);
        const int old = atomic_min(blobs + high, low);
        a = old == high ? low : first_of(blobs, old);
        b = first_of(blobs, low);
    }
}

// The same, of the cells of the BLOBS largest blobs alone (Rymut 2016, 5.5): cells that touch each
// other, at corners too; the one that begins first is the larger one of two with as many pixels.
// blobs: of each cell of each view, and pixels: scratch. One work-group per view.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void blob_region(int2 picture, int margin, __global const char *restrict evidence,
                 __global const int2 *restrict sizes,
                 volatile __global int *blobs, volatile __global int *pixels,
                 __global int4 *restrict regions)
{
    __local int4 scratch[GROUP];
    __local int2 best[GROUP]; // pixels and first cell of a blob
    const int view = get_group_id(0), lane = get_local_id(0), n = ROWS * COLUMNS;
    volatile __global int *blob = blobs + view * n, *filled = pixels + 2 * view * n;
    volatile __global int *large = filled + n;
    for (int cell = lane; cell < n; cell += GROUP) {
        const int count = silhouette_pixels(picture, evidence, view, cell_box(picture, cell));
        filled[cell] = count >= FILLED ? count : 0;
        large[cell] = 0;
        blob[cell] = cell;
    }
    barrier(CLK_GLOBAL_MEM_FENCE);
    for (int cell = lane; cell < n; cell += GROUP) {
        if (filled[cell] == 0) continue;
        const int x = cell % COLUMNS;
        if (x > 0 && filled[cell - 1] > 0) unite(blob, cell, cell - 1);
        if (cell < COLUMNS) continue;
        for (int dx = max(-1, -x); dx <= min(1, COLUMNS - 1 - x); ++dx)
            if (filled[cell - COLUMNS + dx] > 0) unite(blob, cell, cell - COLUMNS + dx);
    }
    barrier(CLK_GLOBAL_MEM_FENCE);
    for (int cell = lane; cell < n; cell += GROUP)
        if (filled[cell] > 0) atomic_add(large + first_of(blob, cell), filled[cell]);
    barrier(CLK_GLOBAL_MEM_FENCE);
    int4 box = (int4)(WIDTH, HEIGHT, 0, 0);
    for (int k = 0; k < BLOBS; ++k) {
        int2 own = (int2)(0, n);
        for (int cell = lane; cell < n; cell += GROUP)
            if (large[cell] > own.x) own = (int2)(large[cell], cell);
        best[lane] = own;
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int half_size = GROUP / 2; half_size > 0; half_size /= 2) {
            if (lane < half_size) {
                const int2 a = best[lane], b = best[lane + half_size];
                best[lane] = b.x > a.x || (b.x == a.x && b.y < a.y) ? b : a;
            }
            barrier(CLK_LOCAL_MEM_FENCE);
        }
        const int chosen = best[0].y;
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int cell = lane; cell < n; cell += GROUP) {
            if (filled[cell] > 0 && first_of(blob, cell) == chosen)
                box = joined(box, cell_box(picture, cell));
            if (cell == chosen) large[cell] = 0;
        }
        barrier(CLK_GLOBAL_MEM_FENCE);
    }
    enclose(box, margin, scratch, sizes[view], regions + view);
}

static inline int grey(__global const uchar *colour)
{
    return (29 * colour[0] + 150 * colour[1] + 77 * colour[2] + 128) >> 8;
}

// A Gaussian of 3x3 pixels, then Sobel's derivative, are one filter of 5x5 pixels that separates
// into (1 4 6 4 1) along one axis and (-1 -2 0 2 1) along the other. This is its part along the
// rows: derivative and smoothed grey, for the region and two rows above and below it. Pixels
// beyond the picture repeat its border. A work-item makes STRIP pixels; those of `derivatives` and
// `smooth` beyond the region are of no use.
__kernel void gradient_rows(int2 picture, __global const uchar *restrict images,
                            __global const int2 *restrict sizes,
                            __global const int4 *restrict regions,
                            __global short *restrict derivatives, __global short *restrict smooth)
{
    const int view = get_global_id(2);
    const int4 box = regions[view];
    const int2 size = sizes[view];
    const int x = box.x + STRIP * get_global_id(0), y = box.y - 2 + get_global_id(1);
    if (x >= box.z || y < 0 || y >= min(box.w + 2, size.y)) return;
    __global const uchar *row = images + 3 * (((size_t)view * HEIGHT + y) * WIDTH);
    short greys[STRIP + 4];
    for (int i = 0; i < STRIP + 4; ++i)
        greys[i] = grey(row + 3 * min(max(x + i - 2, 0), size.x - 1));
    const short8 a = vload8(0, greys), b = vload8(0, greys + 1), c = vload8(0, greys + 2);
    const short8 d = vload8(0, greys + 3), e = vload8(0, greys + 4);
    const size_t at = ((size_t)view * HEIGHT + y) * PITCH + x;
    vstore8((short8)(e - a + (d - b) * (short)2), 0, derivatives + at);
    vstore8((short8)(a + e + (b + d) * (short)4 + c * (short)6), 0, smooth + at);
}

// Is there silhouette within `dilation` pixels along x and y?
static inline bool near_silhouette(int2 picture, int dilation,
                                   __global const char *restrict evidence, int2 size, int view,
                                   int x, int y)
{
    int found = 0;
    for (int v = max(y - dilation, 0); v <= min(y + dilation, size.y - 1); ++v)
        for (int u = max(x - dilation, 0); u <= min(x + dilation, size.x - 1); ++u)
            found |= evidence[((size_t)view * HEIGHT + v) * WIDTH + u] > 0;
    return found;
}

// 255 where the gradient's squared magnitude (Rymut 2016 eq. 2.8) is at least `threshold2` near
// the silhouette; a work-item makes STRIP pixels.
__kernel void gradient_edges(int2 picture, int dilation, int threshold2,
                             __global const short *restrict derivatives,
                             __global const short *restrict smooth,
                             __global const char *restrict evidence,
                             __global const int2 *restrict sizes,
                             __global const int4 *restrict regions,
                             __global uchar *restrict edges)
{
    const int view = get_global_id(2);
    const int4 box = regions[view];
    const int2 size = sizes[view];
    const int x = box.x + STRIP * get_global_id(0), y = box.y + get_global_id(1);
    if (x >= box.z || y >= box.w) return;
    int8 along[5], across[5];
    for (int i = 0; i < 5; ++i) {
        const int v = min(max(y + i - 2, 0), size.y - 1);
        const size_t at = ((size_t)view * HEIGHT + v) * PITCH + x;
        along[i] = convert_int8(vload8(0, derivatives + at));
        across[i] = convert_int8(vload8(0, smooth + at));
    }
    const int8 gx = along[0] + along[4] + (along[1] + along[3]) * 4 + along[2] * 6;
    const int8 gy = across[4] - across[0] + (across[3] - across[1]) * 2;
    int squared[STRIP];
    vstore8(gx * gx + gy * gy, 0, squared);
    const size_t row = ((size_t)view * HEIGHT + y) * WIDTH;
    for (int i = 0; i < min(STRIP, box.z - x); ++i) {
        bool edge = squared[i] >= threshold2;
        if (edge) edge = near_silhouette(picture, dilation, evidence, size, view, x + i, y);
        edges[row + x + i] = edge ? 255 : 0;
    }
}

// 255 where `candidates`, edges found elsewhere, lie near the silhouette.
__kernel void masked_edges(int2 picture, int dilation, __global const uchar *restrict candidates,
                           __global const char *restrict evidence,
                           __global const int2 *restrict sizes,
                           __global const int4 *restrict regions, __global uchar *restrict edges)
{
    const int view = get_global_id(2);
    const int4 box = regions[view];
    const int x = box.x + get_global_id(0), y = box.y + get_global_id(1);
    if (x >= box.z || y >= box.w) return;
    const size_t at = ((size_t)view * HEIGHT + y) * WIDTH + x;
    const bool edge = candidates[at] &&
                      near_silhouette(picture, dilation, evidence, sizes[view], view, x, y);
    edges[at] = edge ? 255 : 0;
}

// 255 on the silhouette's boundary: inside, with a 4-neighbour outside. The border of the picture
// is no boundary.
__kernel void outline_edges(int2 picture, __global const char *restrict evidence,
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

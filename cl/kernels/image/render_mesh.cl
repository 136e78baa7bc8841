// Silhouettes and edges of skinned meshes in all cameras, counted where they are drawn. Twin:
// reference/image_objective/render.py. Defines: those of counting.h, N_VERTICES, N_CORNERS,
// N_LINES, and BAND, the rows whose spans local memory holds.
//
// A part fills each row from its first pixel to its last, as convex ones do; its edge are the
// pixels with one of four neighbours outside of it.
#if !defined(BAND) || !defined(FAR_OUT) || !defined(N_CORNERS) || !defined(N_LINES) || \
    !defined(N_PARTS) || !defined(N_VERTICES)
#error "image/render_mesh.cl needs BAND, FAR_OUT, N_CORNERS, N_LINES, N_PARTS and N_VERTICES"
#endif
#include "common/camera.h"
#include "image/counting.h"

// Rows of a part's spans: those of the band, one above, one below, and what a pack reads too many.
#define STRIDE (BAND + 2 + PACK)
// No pixel at all: as first, and as last.
#define NEVER 0x3fff
#if GROUP == 1
#define WIDEN(first, last, low, high) \
    { \
        *(first) = (low) < *(first) ? (low) : *(first); \
        *(last) = (high) > *(last) ? (high) : *(last); \
    }
#else
#define WIDEN(first, last, low, high) \
    { \
        atomic_min(first, low); \
        atomic_max(last, high); \
    }
#endif

static inline float side_of(float2 a, float2 b, float2 p)
{
    return (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x);
}

// Whether the line between two triangles, a to b, may bound the part: where both are seen, their
// third corners lie on one side of it.
static inline bool is_contour(__global const float2 *pixels, int4 line)
{
    const float2 a = pixels[line.x], b = pixels[line.y];
    if (a.x == FAR_OUT || b.x == FAR_OUT) return false;
    if (line.z < 0) return true;
    const float2 c = pixels[line.z], d = pixels[line.w];
    return c.x == FAR_OUT || d.x == FAR_OUT || side_of(a, b, c) * side_of(a, b, d) >= 0.0f;
}

// Widen a part's spans to the line in the rows `top`..`bottom`, whose first are *first and *last;
// columns within limits.x..limits.y.
INLINED void draw_line(float2 p, float2 q, int top, int bottom, int2 limits,
                       __local int *first, __local int *last)
{
    const float high = p.y < q.y ? p.y : q.y, low = p.y < q.y ? q.y : p.y;
    if (high == low || low < top || high > bottom) return;
    const int from = high <= top ? top : (int)ceil(high);
    const int to = low >= bottom ? bottom : (int)floor(low);
    const float slope = (q.x - p.x) / (q.y - p.y);
    for (int row = from; row <= to; ++row) {
        float x = p.x + (row - p.y) * slope;
        x = x < limits.x ? limits.x : x > limits.y ? limits.y : x;
        const int before = (int)x - (x < (int)x);
        WIDEN(first + row - top, last + row - top, before + (x > before), before);
    }
}

static inline vint larger(vint a, vint b) { return a > b ? a : b; }
static inline vint smaller(vint a, vint b) { return a < b ? a : b; }

// Counts the meshes whose vertices are all_pixels (V, N, N_CORNERS), see counting.h. lines:
// (N_LINES,) ends, and the third corners of the triangles on both sides or -1; owners: their parts.
// edged: (N_PARTS,), whether a part's outline is an edge.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void count_pixels(int n_particles, __global const float2 *all_pixels,
                  __global const int4 *lines, __global const int *owners,
                  __global const int *edged, int2 picture, int pitch,
                  __global const int4 *roi, __global const uint *silhouettes,
                  __global const uchar *proximity, __global int *counts,
                  __global uchar2 *pictures)
{
    const Drawing drawing = DRAWING;
    const int lane = get_local_id(0);
    const int4 region = roi[drawing.view];
    __global const float2 *pixels =
        all_pixels + ((size_t)drawing.view * n_particles + drawing.particle) * N_CORNERS;
    __local int first[N_PARTS * STRIDE], last[N_PARTS * STRIDE];
    __local int order[N_PARTS], totals[N_COUNTS], box[2];
    __local vint spans[2 * N_PARTS * GROUP];
    __local uchar numbers[N_PARTS * GROUP];

    for (int p = lane; p < N_PARTS; p += GROUP) {
        const float mine = pixels[N_VERTICES + p].x;
        int nearer = 0;
        for (int q = 0; q < N_PARTS; ++q) {
            const float other = pixels[N_VERTICES + q].x;
            nearer += other < mine || (other == mine && q < p);
        }
        order[nearer] = p;
    }
    if (lane == 0) {
        box[0] = region.w;
        box[1] = region.y - 1;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int i = lane; i < N_VERTICES; i += GROUP)
        if (pixels[i].x != FAR_OUT)
            WIDEN(&box[0], &box[1], (int)ceil(pixels[i].y), (int)floor(pixels[i].y));
    barrier(CLK_LOCAL_MEM_FENCE);
    const int top = box[0] > region.y ? box[0] : region.y;
    const int bottom = box[1] < region.w - 1 ? box[1] : region.w - 1;

    // Beyond the region's borders, so that these are no edges.
    const int2 limits = (int2)(region.x - 2, region.z + 1);
    Counts counted;
    no_counts(&counted);
    const int n_bands = bottom < top ? 0 : (bottom - top) / BAND + 1;
    for (int band = 0; band < n_bands; ++band) {
        const int above = top + band * BAND - 1;
        const int below = above + BAND + 1 < bottom + 1 ? above + BAND + 1 : bottom + 1;
        for (int i = lane; i < N_PARTS * STRIDE; i += GROUP) {
            first[i] = NEVER;
            last[i] = limits.x - 1;
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int i = lane; i < N_LINES; i += GROUP) {
            const int4 line = lines[i];
            const int at = owners[i] * STRIDE;
            if (is_contour(pixels, line))
                draw_line(pixels[line.x], pixels[line.y], above, below, limits, first + at,
                          last + at);
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int row = above + 1 + lane * PACK; row < below; row += GROUP * PACK) {
            Rows rows = {spans, numbers, 0, region.z, region.x};
            const vint beyond = row + LANE_NUMBERS >= below;
            for (int k = 0; k < N_PARTS; ++k) {
                const int p = order[k], at = p * STRIDE + row - above;
                const vint from = LOAD_PACK(first + at), to = LOAD_PACK(last + at);
                const vint inner_from =
                    larger(from + 1, larger(LOAD_PACK(first + at - 1), LOAD_PACK(first + at + 1)));
                const vint inner_to =
                    smaller(to - 1, smaller(LOAD_PACK(last + at - 1), LOAD_PACK(last + at + 1)));
                const vint start = larger(from, region.x);
                const vint end = beyond ? (vint)(0) : smaller(to + 1, region.z);
                const vint all = start | larger(end, 0) << 16;
                const vint inside = larger(inner_from, region.x) |
                                    larger(smaller(inner_to + 1, region.z), 0) << 16;
                add_spans(&rows, all, edged[p] ? inside : all, p);
            }
            count_rows(&drawing, &rows, row, &counted);
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    write_counts(&drawing, n_particles, &counted, totals);
}

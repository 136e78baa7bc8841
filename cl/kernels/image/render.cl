// Silhouettes and edges of all posed bodies in all cameras, counted where they are drawn. Twin:
// reference/image_objective/render.py. Defines: those of counting.h.
//
// One work-group per particle and camera, one work-item per PACK rows: of the parts that meet the
// rows, near ones first, spans of pixels, then 32 pixels at a time as bits. No picture is stored.
#if !defined(N_PARTS)
#error "image/render.cl needs N_PARTS"
#endif
#include "image/counting.h"
#include "image/parts.h"

// The first and last pixels of a shape in PACK rows; none where first > last.
typedef struct {
    vint first, last;
} Shape;

// The pixels within [low, high] and columns limits.x..limits.y.
static inline Shape shape_of(vfloat low, vfloat high, float2 limits)
{
    // Beyond the limits integers would overflow.
    low = within(low, limits.x, limits.y + 1.0f);
    high = within(high, limits.x - 1.0f, limits.y);
    return (Shape){first_from(low), TO_INT(high + 1.0f) - 1};
}

// From the first pixel of both to the last.
static inline Shape joined(Shape a, Shape b)
{
    const vint no_a = a.first > a.last, some_b = b.first <= b.last;
    return (Shape){(no_a | (some_b & (b.first < a.first))) ? b.first : a.first,
                   (no_a | (some_b & (b.last > a.last))) ? b.last : a.last};
}

// The spans of `part` in `rows` up to `bottom`: all its pixels, and those of them that are no edge,
// within columns limits.x..limits.y.
INLINED void rows_of(__local const Part *part, vint rows, float2 limits, int bottom,
                     vint *all, vint *inside)
{
    const vfloat y = TO_FLOAT(rows);
    vfloat low = limits.x, high = limits.y, inner_low = low, inner_high = high;
    for (int i = 0; i < 4; ++i) {
        const Side side = part->sides[i];
        const vfloat x = side.x + side.slope * (y - side.y);
        // How far into the part a pixel has a neighbour, in its row or the next, outside.
        const float steep = side.slope < 0.0f ? -side.slope : side.slope;
        const float rim = steep > 1.0f ? steep : 1.0f;
        const bool edge = (i & 1) || ((part->outlined >> (i / 2)) & 1);
        if (side.left) {
            low = most(low, x);
            if (edge) inner_low = most(inner_low, x + rim);
        } else {
            high = least(high, x);
            if (edge) inner_high = least(inner_high, x - rim);
        }
    }
    const float2 none = (float2)(limits.y + 1.0f, limits.x - 1.0f);
    Shape shape = shape_of(part->bare ? none.x : low, part->bare ? none.y : high, limits);
    Shape inner =
        shape_of(part->bare ? none.x : inner_low, part->bare ? none.y : inner_high, limits);
    for (int e = 0; e < 2; ++e) {
        const float radius = part->radii[e], x = part->ends[e].x;
        const vfloat offset = y - part->ends[e].y, away = offset < 0.0f ? -offset : offset;
        if (radius == 0.0f || !any(TO_INT(away - radius - 1.0f))) continue;
        const vfloat squared = radius * radius - away * away;
        const vfloat wide = squared < 0.0f ? (vfloat)(-1e6f) : sqrt(most(squared, 0.0f));
        shape = joined(shape, shape_of(x - wide, x + wide, limits));
        if (!((part->outlined >> e) & 1)) continue;
        const vfloat beyond = squared - 2.0f * away - 1.0f;
        const vfloat inner_wide =
            beyond < 0.0f ? (vfloat)(-1e6f) : least(wide - 1.0f, sqrt(most(beyond, 0.0f)));
        inner = joined(inner, shape_of(x - inner_wide, x + inner_wide, limits));
    }
    const vint hidden = (rows < part->top) | (rows > part->bottom) | (rows > bottom);
    *all = shape.first | (hidden ? (vint)(0) : shape.last + 1) << 16;
    *inside = part->edged ? inner.first | (inner.last + 1) << 16 : *all;
}

// Counts the parts (V, N, N_PARTS), see counting.h.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void count_pixels(int n_particles, __global const Part *all_parts, int2 picture, int pitch,
                  __global const int4 *roi, __global const uint *silhouettes,
                  __global const uchar *proximity, __global int *counts,
                  __global uchar2 *pictures)
{
    const Drawing drawing = DRAWING;
    const int lane = get_local_id(0);
    const int4 region = roi[drawing.view];
    __local Part parts[N_PARTS];
    __local vint spans[2 * N_PARTS * GROUP];
    __local uchar numbers[N_PARTS * GROUP];
    __local int totals[N_COUNTS];
    // Near ones first, so that each hides those after it.
    __global const Part *mine =
        all_parts + ((size_t)drawing.view * n_particles + drawing.particle) * N_PARTS;
    for (int p = lane; p < N_PARTS; p += GROUP) {
        const float distance = mine[p].distance;
        int nearer = 0;
        for (int q = 0; q < N_PARTS; ++q)
            nearer += mine[q].distance < distance || (mine[q].distance == distance && q < p);
        parts[nearer] = mine[p];
    }
    barrier(CLK_LOCAL_MEM_FENCE);

    int top = region.w, bottom = region.y - 1;
    for (int p = 0; p < N_PARTS; ++p) {
        const int first = parts[p].top, last = parts[p].bottom;
        top = first <= last && first < top ? first : top;
        bottom = first <= last && last > bottom ? last : bottom;
    }
    top = top > region.y ? top : region.y;
    bottom = bottom < region.w - 1 ? bottom : region.w - 1;

    Counts counted;
    no_counts(&counted);
    for (int row = top + lane * PACK; row <= bottom; row += GROUP * PACK) {
        Rows rows = {spans, numbers, 0, region.z, region.x};
        for (int p = 0; p < N_PARTS; ++p) {
            if (row + PACK - 1 < parts[p].top || row > parts[p].bottom) continue;
            vint all, inside;
            rows_of(&parts[p], row + LANE_NUMBERS, (float2)(region.x, region.z - 1), bottom, &all,
                    &inside);
            add_spans(&rows, all, inside, parts[p].number);
        }
        count_rows(&drawing, &rows, row, &counted);
    }
    write_counts(&drawing, n_particles, &counted, totals);
}

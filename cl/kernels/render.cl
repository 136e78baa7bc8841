// Silhouettes and edges of all posed bodies in all cameras, counted where they are drawn. Twin:
// reference/render.py. Defines: those of counting.h.
//
// One work-group per particle and camera, one work-item per PACK rows: of the parts that meet the
// rows, near ones first, spans of pixels, then 32 pixels at a time as bits. No picture is stored.
#include "counting.h"
#include "parts.h"

// The spans of `part` in `rows` up to `bottom`: all its pixels, and those of them that are no edge,
// within columns limits.x..limits.y.
inline void rows_of(__local const Part *part, vint rows, float2 limits, int bottom, vint *all,
                    vint *inside)
{
    const vfloat y = TO_FLOAT(rows);
    vfloat low = limits.x, high = limits.y, inner_low = limits.x, inner_high = limits.y;
    if (part->radius > 0.0f) {
        const vfloat offset = y - part->centre.y, away = offset < 0.0f ? -offset : offset;
        const float r2 = part->radius * part->radius;
        const vfloat half_width = sqrt(most(r2 - away * away, 0.0f));
        const vfloat beyond = r2 - (away + 1.0f) * (away + 1.0f);
        const vfloat inner =
            beyond < 0.0f ? (vfloat)(-1.0f) : least(half_width - 1.0f, sqrt(most(beyond, 0.0f)));
        low = most(low, part->centre.x - half_width);
        high = least(high, part->centre.x + half_width);
        inner_low = most(inner_low, part->centre.x - inner);
        inner_high = least(inner_high, part->centre.x + inner);
    } else {
        for (int i = 0; i < 4; ++i) {
            const Side side = part->sides[i];
            const vfloat x = side.x + side.slope * (y - side.y);
            // How far into the part a pixel has a neighbour, in its row or the next, outside.
            const float steep = side.slope < 0.0f ? -side.slope : side.slope;
            const float rim = steep > 1.0f ? steep : 1.0f;
            if (side.left) {
                low = most(low, x);
                if (i & 1) inner_low = most(inner_low, x + rim);
            } else {
                high = least(high, x);
                if (i & 1) inner_high = least(inner_high, x - rim);
            }
        }
    }
    if (!part->edged) {
        inner_low = low;
        inner_high = high;
    }
    const vint hidden = (rows < part->top) | (rows > part->bottom) | (rows > bottom);
    high = hidden ? (vfloat)(-1.0f) : most(high, -1.0f);
    // Beyond the limits integers would overflow.
    *all = span_within(least(low, limits.y + 1.0f), high);
    *inside = span_within(least(inner_low, limits.y + 1.0f), most(inner_high, -1.0f));
}

// Counts the parts (V, N, N_PARTS), see counting.h.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void count_pixels(int n_particles, __global const Part *all_parts, COMPARED)
{
    const Picture picture = PICTURE;
    const int lane = get_local_id(0);
    const int4 region = roi[picture.view];
    __local Part parts[N_PARTS];
    __local vint spans[2 * N_PARTS * GROUP];
    __local uchar numbers[N_PARTS * GROUP];
    __local int totals[N_COUNTS];
    // Near ones first, so that each hides those after it.
    __global const Part *mine =
        all_parts + ((size_t)picture.view * n_particles + picture.particle) * N_PARTS;
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
        count_rows(&picture, &rows, row, &counted);
    }
    write_counts(&picture, n_particles, &counted, totals);
}

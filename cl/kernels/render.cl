// Silhouettes and edges of all posed bodies in all cameras, counted where they are drawn. Twin:
// reference/render.py. Defines: N_PARTS, N_LABELS, GROUP, PACK, and WIDTH of the pictures.
//
// One work-group per particle and camera, one work-item per PACK rows: of the parts that meet the
// rows, near ones first, spans of pixels, then 32 pixels at a time as bits. No picture is stored.
#include "spans.h"
#include "parts.h"

#define WORDS ((WIDTH + 31) / 32)
#define N_COUNTS (2 + 2 * N_LABELS)

inline vint popcounts(vuint bits) { return TO_INT(popcount(bits)); }

// The spans of `part` in `rows`: all its pixels, and those of them that are no edge, within columns
// limits.x..limits.y.
inline void rows_of(__local const Part *part, vint rows, float2 limits, vint *all, vint *inside)
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
    // Beyond the limits integers would overflow; the last row of limits makes spans empty.
    const vint hidden = (rows < part->top) | (rows > part->bottom);
    high = hidden ? (vfloat)(-1.0f) : most(high, -1.0f);
    *all = span_within(least(low, limits.y + 1.0f), high);
    *inside = span_within(least(inner_low, limits.y + 1.0f), most(inner_high, -1.0f));
}

// counts (V, N, N_COUNTS): visible edge pixels, the sum of `proximity` (V, height, WIDTH) there,
// then per label the model's pixels and those of them in the silhouette of that label (Rymut 2016
// eq. 4.36-4.40, 4.30-4.34), all within the region of interest roi (V, 4) = first column and row,
// ends excluded. labels: (N_PARTS,), 0 to N_LABELS - 1. silhouettes: bits (V, N_LABELS, WORDS,
// pitch), the word of a row beside those of its neighbours.
// With DRAW it also writes pictures (N, V, height, WIDTH) uchar2: number of the part seen, from 1,
// and 255 on an edge.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void count_pixels(int n_particles, int height, int pitch, __global const Part *all_parts,
                  __global const int4 *roi, __global const int *labels,
                  __global const uint *silhouettes, __global const uchar *proximity,
                  __global int *counts
#ifdef DRAW
                  , __global uchar2 *pictures
#endif
)
{
    const int particle = get_group_id(0), view = get_group_id(1), lane = get_local_id(0);
    __local Part parts[N_PARTS];
    __local int totals[N_COUNTS];
    __local vint spans[2 * N_PARTS * GROUP];  // one column per work-item
    __local uchar numbers[N_PARTS * GROUP];
    const int4 region = roi[view];
    for (int i = lane; i < N_COUNTS; i += GROUP) totals[i] = 0;
    // Near ones first, so that each hides those after it.
    __global const Part *mine = all_parts + ((size_t)view * n_particles + particle) * N_PARTS;
    for (int p = lane; p < N_PARTS; p += GROUP) {
        const float distance = mine[p].distance;
        int nearer = 0;
        for (int q = 0; q < N_PARTS; ++q)
            nearer += mine[q].distance < distance || (mine[q].distance == distance && q < p);
        parts[nearer] = mine[p];
    }
    barrier(CLK_LOCAL_MEM_FENCE);

    const float2 limits = (float2)(region.x, region.z - 1);
    int top = region.w, bottom = region.y - 1;
    for (int p = 0; p < N_PARTS; ++p) {
        const int first = parts[p].top, last = parts[p].bottom;
        top = first <= last && first < top ? first : top;
        bottom = first <= last && last > bottom ? last : bottom;
    }
    top = top > region.y ? top : region.y;
    bottom = bottom < region.w - 1 ? bottom : region.w - 1;

    int edge_sum = 0;
    vint edge_count = 0, area[N_LABELS], overlap[N_LABELS];
    for (int l = 0; l < N_LABELS; ++l) area[l] = overlap[l] = 0;
    for (int row = top + lane * PACK; row <= bottom; row += GROUP * PACK) {
        const vint rows = row + LANE_NUMBERS;
        int n = 0;
        vint first = region.z, end = region.x;
        for (int p = 0; p < N_PARTS; ++p) {
            if (row + PACK - 1 < parts[p].top || row > parts[p].bottom) continue;
            vint all, inside;
            rows_of(&parts[p], rows, limits, &all, &inside);
            // Rows from `bottom` on belong to nobody.
            all = rows > bottom ? (vint)(0) : all;
            const vint from = all & 0xffff, to = all >> 16;
            first = ((from < first) & (from < to)) ? from : first;
            end = ((to > end) & (from < to)) ? to : end;
            spans[(2 * n) * GROUP + lane] = all;
            spans[(2 * n + 1) * GROUP + lane] = inside;
            numbers[n * GROUP + lane] = parts[p].number;
            ++n;
        }
        int firsts[PACK], ends[PACK];
        STORE_PACK(first, firsts);
        STORE_PACK(end, ends);
        int column = firsts[0], last = ends[0];
        for (int l = 1; l < PACK; ++l) {
            column = firsts[l] < column ? firsts[l] : column;
            last = ends[l] > last ? ends[l] : last;
        }
        for (int word = column >> 5; 32 * word < last; ++word) {
            vuint covered = 0, edges = 0;
            for (int i = 0; i < n; ++i) {
                const vuint seen = span_bits(spans[(2 * i) * GROUP + lane], word) & ~covered;
                covered |= seen;
                edges |= seen & ~span_bits(spans[(2 * i + 1) * GROUP + lane], word);
#if N_LABELS > 1
                const int label = labels[numbers[i * GROUP + lane]];
                const size_t at = ((size_t)view * N_LABELS + label) * WORDS + word;
                area[label] += popcounts(seen);
                overlap[label] += popcounts(seen & LOAD_ROWS(silhouettes + at * pitch + row));
#endif
#ifdef DRAW
                uint shown[PACK], rims[PACK];
                STORE_PACK(seen, shown);
                STORE_PACK(edges, rims);
                const size_t at_row = ((size_t)particle * get_num_groups(1) + view) * height + row;
                for (int l = 0; l < PACK; ++l)
                    for (int k = 0; k < 32; ++k)
                        if (shown[l] >> k & 1)
                            pictures[(at_row + l) * WIDTH + 32 * word + k] = (uchar2)(
                                numbers[i * GROUP + lane] + 1, rims[l] >> k & 1 ? 255 : 0);
#endif
            }
#if N_LABELS == 1
            const size_t at = (size_t)view * WORDS + word;
            area[0] += popcounts(covered);
            overlap[0] += popcounts(covered & LOAD_ROWS(silhouettes + at * pitch + row));
#endif
            edge_count += popcounts(edges);
            uint rims[PACK];
            STORE_PACK(edges, rims);
            __global const uchar *near_edge =
                proximity + ((size_t)view * height + row) * WIDTH + 32 * word + 31;
            for (int l = 0; l < PACK; ++l)
                for (uint bits = rims[l]; bits; bits &= bits - 1)
                    edge_sum += near_edge[l * WIDTH - (int)clz(bits & -bits)];
        }
    }
    int lanes[PACK];
    STORE_PACK(edge_count, lanes);
    for (int l = 0; l < PACK; ++l) atomic_add(&totals[0], lanes[l]);
    atomic_add(&totals[1], edge_sum);
    for (int k = 0; k < N_LABELS; ++k) {
        STORE_PACK(area[k], lanes);
        for (int l = 0; l < PACK; ++l) atomic_add(&totals[2 + 2 * k], lanes[l]);
        STORE_PACK(overlap[k], lanes);
        for (int l = 0; l < PACK; ++l) atomic_add(&totals[3 + 2 * k], lanes[l]);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int i = lane; i < N_COUNTS; i += GROUP)
        counts[((size_t)view * n_particles + particle) * N_COUNTS + i] = totals[i];
}

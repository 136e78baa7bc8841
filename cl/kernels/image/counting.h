// Counting the pixels of spans, PACK rows and 32 columns at a time; shared by render.cl and
// render_mesh.cl. Defines: N_PARTS, GROUP and PACK.
//
// What is counted, counts (V, N, N_COUNTS): visible edge pixels, the sum of `proximity` (V, HEIGHT,
// WIDTH) there, the model's pixels and those of them in the silhouette (Rymut 2016 eq. 4.36-4.40),
// all within the region of interest roi (V, 4) = first column and row, ends excluded. silhouettes:
// bits (V, WORDS, pitch), the word of a row beside those of its neighbours.
// With DRAW also pictures (N, V, HEIGHT, WIDTH) uchar2: number of the part seen, from 1, and 255 on
// an edge; without, there need be none.
#if !defined(GROUP)
#error "image/counting.h needs GROUP"
#endif
#include "common/sizes.h"
#include "image/spans.h"

#define WORDS ((WIDTH + 31) / 32)
#define N_COUNTS 4

// What the counting kernels have in common: what is compared, and which pose and view.
#define DRAWING {picture, pitch, get_group_id(0), get_group_id(1), get_num_groups(1), roi, \
                 silhouettes, proximity, counts, pictures}
typedef struct {
    int2 picture;
    int pitch, particle, view, n_views;
    __global const int4 *roi;
    __global const uint *silhouettes;
    __global const uchar *proximity;
    __global int *counts;
    __global uchar2 *pictures;
} Drawing;

// Of one work-item: the spans of the parts that meet its rows, near ones first, all pixels and
// those that are no edge, and the columns in which there are any. One column of local memory each.
typedef struct {
    __local vint *spans;
    __local uchar *numbers;
    int n;
    vint first, end;
} Rows;

typedef struct {
    vint edges, area, overlap;
    int near_edge;
} Counts;

static inline vint popcounts(vuint bits) { return TO_INT(popcount(bits)); }

static inline void no_counts(Counts *counts)
{
    counts->edges = counts->area = counts->overlap = 0;
    counts->near_edge = 0;
}

// Put the spans of part `number` behind those that are nearer, unless there is none.
INLINED void add_spans(Rows *rows, vint all, vint inside, int number)
{
    const int at = rows->n * GROUP + get_local_id(0);
    const vint first = all & 0xffff, end = all >> 16;
    if (!any(first - end)) return;  // all signs positive
    rows->first = ((first < rows->first) & (first < end)) ? first : rows->first;
    rows->end = ((end > rows->end) & (first < end)) ? end : rows->end;
    rows->spans[2 * rows->n * GROUP + get_local_id(0)] = all;
    rows->spans[(2 * rows->n + 1) * GROUP + get_local_id(0)] = inside;
    rows->numbers[at] = number;
    ++rows->n;
}

// Count the PACK rows from `row` on.
INLINED void count_rows(const Drawing *drawing, const Rows *rows, int row, Counts *counts)
{
    const int lane = get_local_id(0), view = drawing->view;
    const int2 picture = drawing->picture;
    int firsts[PACK], ends[PACK];
    STORE_PACK(rows->first, firsts);
    STORE_PACK(rows->end, ends);
    int column = firsts[0], last = ends[0];
    for (int l = 1; l < PACK; ++l) {
        column = firsts[l] < column ? firsts[l] : column;
        last = ends[l] > last ? ends[l] : last;
    }
    for (int word = column >> 5; 32 * word < last; ++word) {
        vuint covered = 0, edges = 0;
        for (int i = 0; i < rows->n; ++i) {
            const vuint seen = span_bits(rows->spans[2 * i * GROUP + lane], word) & ~covered;
            covered |= seen;
            edges |= seen & ~span_bits(rows->spans[(2 * i + 1) * GROUP + lane], word);
#ifdef DRAW
            uint shown[PACK], rims[PACK];
            STORE_PACK(seen, shown);
            STORE_PACK(edges, rims);
            const size_t at_row =
                ((size_t)drawing->particle * drawing->n_views + view) * HEIGHT + row;
            for (int l = 0; l < PACK; ++l)
                for (int k = 0; k < 32; ++k)
                    if (shown[l] >> k & 1)
                        drawing->pictures[(at_row + l) * WIDTH + 32 * word + k] = (uchar2)(
                            rows->numbers[i * GROUP + lane] + 1, rims[l] >> k & 1 ? 255 : 0);
#endif
        }
        const size_t at = (size_t)view * WORDS + word;
        const vuint image = LOAD_PACK(drawing->silhouettes + at * drawing->pitch + row);
        counts->area += popcounts(covered);
        counts->overlap += popcounts(covered & image);
        counts->edges += popcounts(edges);
        uint rims[PACK];
        STORE_PACK(edges, rims);
        __global const uchar *near_edge =
            drawing->proximity + ((size_t)view * HEIGHT + row) * WIDTH + 32 * word + 31;
        for (int l = 0; l < PACK; ++l)
            for (uint bits = rims[l]; bits; bits &= bits - 1)
                counts->near_edge += near_edge[l * WIDTH - (int)clz(bits & -bits)];
    }
}

static inline int lane_sum(vint pack)
{
    int lanes[PACK], sum = 0;
    STORE_PACK(pack, lanes);
    for (int l = 0; l < PACK; ++l) sum += lanes[l];
    return sum;
}

// Add up what the work-items counted.
INLINED void write_counts(const Drawing *drawing, int n_particles, const Counts *counts,
                          __local int *totals)
{
    const int lane = get_local_id(0);
    for (int i = lane; i < N_COUNTS; i += GROUP) totals[i] = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    atomic_add(&totals[0], lane_sum(counts->edges));
    atomic_add(&totals[1], counts->near_edge);
    atomic_add(&totals[2], lane_sum(counts->area));
    atomic_add(&totals[3], lane_sum(counts->overlap));
    barrier(CLK_LOCAL_MEM_FENCE);
    const size_t at = (size_t)drawing->view * n_particles + drawing->particle;
    for (int i = lane; i < N_COUNTS; i += GROUP) drawing->counts[at * N_COUNTS + i] = totals[i];
}

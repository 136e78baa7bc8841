// Silhouettes and edges of all posed bodies in all cameras, counted where they are drawn; the flat
// model of Rymut 2016, 4.3: a part is the trapezoid that its cone shows to the camera. Twin:
// reference/render.py. Defines: N_PARTS, N_LABELS, GROUP, and WIDTH of the pictures.
//
// One work-group per particle and camera, one work-item per row: of the parts that meet the row,
// near ones first, spans of pixels, then 32 pixels at a time as bits. No picture is stored.
#include "camera.h"
#include "cones.h"
#include "spans.h"

#define WORDS ((WIDTH + 31) / 32)
#define N_COUNTS (2 + 2 * N_LABELS)
// Corners further out than this, px, count as unseen, as in likelihood.cl.
#define FAR_OUT 1e5f
// Lines flatter than this, px from end to end, are tilted so much.
#define FLAT 1e-4f

// A side of a trapezoid: the pixels right (left) of the line x + slope (row - y) are inside.
typedef struct {
    float x, y, slope;
    int left;  // 1 where the line is the trapezoid's left border
} Side;

// A part in a picture. Where radius > 0 it is a disc around `centre` instead of a trapezoid. Of the
// sides, 1 and 3 are the long ones, which show an edge.
typedef struct {
    Side sides[4];
    float2 centre;
    float radius, distance;
    int top, bottom;  // first and last row
    int number;  // of its cone
    int edged;   // whether its outline is an edge
} Part;

inline Side side_between(float2 p, float2 q, float turn)
{
    const float2 along = q - p;
    const float rise = fabs(along.y) >= FLAT ? along.y : along.y < 0.0f ? -FLAT : FLAT;
    Side side = {p.x, p.y, along.x / rise, turn * rise < 0.0f};
    return side;
}

inline float cross2(float2 a, float2 b) { return a.x * b.y - a.y * b.x; }

// What `cone` shows to `camera`; no row at all (top > bottom) where a corner is unseen.
inline Part flat_part(__global const float *cone, __global const float *camera, int number,
                      int edged)
{
    const float3 eye = vload3(0, camera + 25);
    float3 corners[4];
    cone_corners(cone, eye, corners);
    float2 pixels[4];
    bool seen = true;
    for (int i = 0; i < 4; ++i) {
        seen &= camera_project(camera, corners[i].x, corners[i].y, corners[i].z, &pixels[i]) > 0;
        seen &= all(fabs(pixels[i]) < FAR_OUT);
    }
    const float turn = cross2(pixels[2] - pixels[0], pixels[3] - pixels[1]);
    Part part;
    for (int i = 0; i < 4; ++i) part.sides[i] = side_between(pixels[i], pixels[(i + 1) % 4], turn);

    // Seen along its axis a cone shows an end rather than its side: a disc.
    const float wide = fmax(distance(pixels[0], pixels[1]), distance(pixels[2], pixels[3]));
    const float2 a = 0.5f * (pixels[0] + pixels[1]), b = 0.5f * (pixels[2] + pixels[3]);
    part.centre = 0.5f * (a + b);
    part.radius = distance(a, b) < 0.5f * wide ? 0.5f * wide : 0.0f;
    float top = fmin(fmin(pixels[0].y, pixels[1].y), fmin(pixels[2].y, pixels[3].y));
    float bottom = fmax(fmax(pixels[0].y, pixels[1].y), fmax(pixels[2].y, pixels[3].y));
    if (part.radius > 0.0f) {
        top = part.centre.y - part.radius;
        bottom = part.centre.y + part.radius;
    }
    part.top = seen ? (int)ceil(top) : 1;
    part.bottom = seen ? (int)floor(bottom) : 0;
    part.distance = distance(eye, 0.5f * (vload3(0, cone) + vload3(0, cone + 4)));
    part.number = number;
    part.edged = edged;
    return part;
}

// The pixels (first, last) of `part` in `row` and those of them that are no edge (first, last),
// within columns limits.x..limits.y.
inline short4 row_of(__local const Part *part, int row, float2 limits)
{
    float low = limits.x, high = limits.y, inner_low = limits.x, inner_high = limits.y;
    if (part->radius > 0.0f) {
        const float away = fabs(row - part->centre.y), r2 = part->radius * part->radius;
        const float half_width = sqrt(fmax(r2 - away * away, 0.0f));
        const float beyond = r2 - (away + 1.0f) * (away + 1.0f);
        const float inner = beyond < 0.0f ? -1.0f : fmin(half_width - 1.0f, sqrt(beyond));
        low = fmax(low, part->centre.x - half_width);
        high = fmin(high, part->centre.x + half_width);
        inner_low = fmax(inner_low, part->centre.x - inner);
        inner_high = fmin(inner_high, part->centre.x + inner);
    } else {
        for (int i = 0; i < 4; ++i) {
            const Side side = part->sides[i];
            const float x = side.x + side.slope * (row - side.y);
            // How far into the part a pixel has a neighbour, in its row or the next, outside.
            const float rim = fmax(1.0f, fabs(side.slope));
            if (side.left) {
                low = fmax(low, x);
                if (i & 1) inner_low = fmax(inner_low, x + rim);
            } else {
                high = fmin(high, x);
                if (i & 1) inner_high = fmin(inner_high, x - rim);
            }
        }
    }
    if (!part->edged) {
        inner_low = low;
        inner_high = high;
    }
    // Beyond the limits integers would overflow.
    low = fmin(low, limits.y + 1.0f);
    inner_low = fmin(inner_low, limits.y + 1.0f);
    return (short4)(first_pixel(low), last_pixel(high), first_pixel(inner_low),
                    last_pixel(inner_high));
}


// counts (V, N, N_COUNTS): visible edge pixels, the sum of `proximity` there, then per label the
// model's pixels and those of them in the silhouette of that label (Rymut 2016 eq. 4.36-4.40,
// 4.30-4.34), all within the region of interest roi (V, 4) = first column and row, ends excluded.
// labels: (N_PARTS,) label, 0 to N_LABELS - 1, and whether the part shows edges. silhouettes: (V, N_LABELS, height, WORDS) bits.
// With DRAW it also writes pictures (N, V, height, WIDTH) uchar2: number of the part seen, from 1,
// and 255 on an edge.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void count_pixels(int n_particles, int height, __global const float *cones,
                  __global const float *cameras, __global const int4 *roi,
                  __global const int2 *labels, __global const uint *silhouettes,
                  __global const uchar *proximity, __global int *counts
#ifdef DRAW
                  , __global uchar2 *pictures
#endif
)
{
    const int particle = get_group_id(0), view = get_group_id(1), lane = get_local_id(0);
    __local float distances[N_PARTS];
    __local Part unsorted[N_PARTS], parts[N_PARTS];
    __local int totals[N_COUNTS];
    __local short4 spans[N_PARTS * GROUP];  // one column per work-item
    __local uchar numbers[N_PARTS * GROUP];
    for (int i = lane; i < N_COUNTS; i += GROUP) totals[i] = 0;
    __global const float *posed = cones + (size_t)particle * N_PARTS * CONE_FLOATS;
    for (int p = lane; p < N_PARTS; p += GROUP) {
        const Part part = flat_part(posed + p * CONE_FLOATS, cameras + view * CAMERA_FLOATS, p,
                                    labels[p].y);
        distances[p] = part.distance;
        unsorted[p] = part;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    // Near ones first, so that each hides those after it.
    for (int p = lane; p < N_PARTS; p += GROUP) {
        int nearer = 0;
        for (int q = 0; q < N_PARTS; ++q)
            nearer += distances[q] < distances[p] || (distances[q] == distances[p] && q < p);
        parts[nearer] = unsorted[p];
    }
    barrier(CLK_LOCAL_MEM_FENCE);

    const int4 region = roi[view];
    const float2 limits = (float2)(region.x, region.z - 1);
    int top = region.w, bottom = region.y - 1;
    for (int p = 0; p < N_PARTS; ++p) {
        if (parts[p].top > parts[p].bottom) continue;
        top = min(top, parts[p].top);
        bottom = max(bottom, parts[p].bottom);
    }
    top = max(top, region.y);
    bottom = min(bottom, region.w - 1);

    int edge_count = 0, edge_sum = 0, area[N_LABELS], overlap[N_LABELS];
    for (int l = 0; l < N_LABELS; ++l) area[l] = overlap[l] = 0;
    for (int row = top + lane; row <= bottom; row += GROUP) {
        int n = 0, first = region.z, last = region.x - 1;
        for (int p = 0; p < N_PARTS; ++p) {
            if (row < parts[p].top || row > parts[p].bottom) continue;
            const short4 span = row_of(&parts[p], row, limits);
            if (span.x > span.y) continue;
            spans[n * GROUP + lane] = span;
            numbers[n * GROUP + lane] = parts[p].number;
            first = min(first, (int)span.x);
            last = max(last, (int)span.y);
            ++n;
        }
        __global const uchar *near_edge = proximity + ((size_t)view * height + row) * WIDTH;
        for (int word = first / 32; word <= last / 32; ++word) {
            uint covered = 0, edges = 0;
            for (int i = 0; i < n; ++i) {
                const short4 span = spans[i * GROUP + lane];
                const uint seen = span_bits(span.x, span.y, word) & ~covered;
                covered |= seen;
                edges |= seen & ~span_bits(span.z, span.w, word);
#if N_LABELS > 1
                const int label = labels[numbers[i * GROUP + lane]].x;
                const size_t at = ((size_t)view * N_LABELS + label) * height + row;
                area[label] += popcount(seen);
                overlap[label] += popcount(seen & silhouettes[at * WORDS + word]);
#endif
#ifdef DRAW
                const size_t at_row = ((size_t)particle * get_num_groups(1) + view) * height + row;
                for (int k = 0; k < 32; ++k)
                    if (seen >> k & 1)
                        pictures[at_row * WIDTH + 32 * word + k] =
                            (uchar2)(numbers[i * GROUP + lane] + 1, edges >> k & 1 ? 255 : 0);
#endif
            }
#if N_LABELS == 1
            area[0] += popcount(covered);
            overlap[0] += popcount(covered & silhouettes[((size_t)view * height + row) * WORDS
                                                         + word]);
#endif
            edge_count += popcount(edges);
            for (; edges; edges &= edges - 1)
                edge_sum += near_edge[32 * word + 31 - clz(edges & -edges)];
        }
    }
    atomic_add(&totals[0], edge_count);
    atomic_add(&totals[1], edge_sum);
    for (int l = 0; l < N_LABELS; ++l) {
        atomic_add(&totals[2 + 2 * l], area[l]);
        atomic_add(&totals[3 + 2 * l], overlap[l]);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int i = lane; i < N_COUNTS; i += GROUP)
        counts[((size_t)view * n_particles + particle) * N_COUNTS + i] = totals[i];
}

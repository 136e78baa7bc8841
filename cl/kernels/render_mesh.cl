// Silhouettes and edges of skinned meshes in all cameras, counted where they are drawn. Twin:
// reference/render.py. Defines: N_PARTS, N_LABELS, N_VERTICES, N_CORNERS, N_BONES, N_TRIANGLES,
// N_BINDS bones per vertex, GROUP, WIDTH of the pictures, CAPACITY of local memory in words.
//
// A vertex past N_VERTICES is the middle of a part; its distance says which part hides which.
#include "camera.h"
#include "cones.h"
#include "spans.h"

#define WORDS ((WIDTH + 31) / 32)
#define N_COUNTS (2 + 2 * N_LABELS)
// Vertices further out than this, px, count as unseen, as in likelihood.cl.
#define FAR_OUT 1e5f

// Linear blend skinning, Rymut 2016 eq. (4.25), and projection. frames: (N, N_BONES, CONE_FLOATS),
// bones posed as cones from the origin to the end of their third axis. binds: N_CORNERS x N_BINDS
// positions in a bone's frame and weights; bind_bones: the bones. pixels: (V, N, N_CORNERS), far
// out where unseen; for the middles (distance to the camera, 0).
__kernel void project_vertices(int n_particles, __global const float *frames,
                               __global const float *cameras, __global const float4 *binds,
                               __global const int *bind_bones, __global float2 *pixels)
{
    const int vertex = get_global_id(0), particle = get_global_id(1), view = get_global_id(2);
    if (vertex >= N_CORNERS || particle >= n_particles) return;
    __global const float *bones = frames + (size_t)particle * N_BONES * CONE_FLOATS;
    float3 point = (float3)(0.0f);
    for (int i = 0; i < N_BINDS; ++i) {
        const float4 bind = binds[vertex * N_BINDS + i];
        __global const float *bone = bones + bind_bones[vertex * N_BINDS + i] * CONE_FLOATS;
        const float3 origin = vload3(0, bone);
        const float3 placed = origin + bind.x * vload3(0, bone + 8) + bind.y * vload3(0, bone + 12)
                              + bind.z * (vload3(0, bone + 4) - origin);
        point += bind.w * placed;
    }
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    float2 pixel;
    const float depth = camera_project(camera, point.x, point.y, point.z, &pixel);
    if (vertex >= N_VERTICES)
        pixel = (float2)(distance(point, vload3(0, camera + 25)), 0.0f);
    else if (depth <= 0.0f || any(fabs(pixel) >= FAR_OUT))
        pixel = (float2)(FAR_OUT, FAR_OUT);
    pixels[((size_t)view * n_particles + particle) * N_CORNERS + vertex] = pixel;
}

// Widen `low`..`high` to where the line from p to q meets the row `y`.
inline void widen(float2 p, float2 q, float y, float *low, float *high)
{
    if (p.y == q.y || y < fmin(p.y, q.y) || y > fmax(p.y, q.y)) return;
    const float x = p.x + (y - p.y) * (q.x - p.x) / (q.y - p.y);
    *low = fmin(*low, x);
    *high = fmax(*high, x);
}

// A mask's bits of `word` that have all four neighbours in it. masks: of one part, rows of `words`
// words; (row, word) is not in the first or last row.
inline uint inner_bits(__local const uint *mask, int words, int word)
{
    const uint here = mask[word];
    const uint before = word > 0 ? mask[word - 1] : 0, after = word + 1 < words ? mask[word + 1] : 0;
    return here & mask[word - words] & mask[word + words] & (here << 1 | before >> 31) &
           (here >> 1 | after << 31);
}

// As count_pixels of render.cl, from triangles (N_TRIANGLES,) of vertices and a part. A part is the
// union of its triangles, its edge the pixels with one of four neighbours outside of it. A band of
// rows at a time is drawn into local memory, one bit per part and pixel, with a row more above and
// below. sizes: (V,) the largest region to look at.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void count_pixels(int n_particles, int height, int pitch, __global const float2 *all_pixels,
                  __global const int4 *triangles, __global const int4 *roi,
                  __global const int2 *labels, __global const uint *silhouettes,
                  __global const uchar *proximity, __global int *counts
#ifdef DRAW
                  , __global uchar2 *pictures
#endif
)
{
    const int particle = get_group_id(0), view = get_group_id(1), lane = get_local_id(0);
    __global const float2 *pixels =
        all_pixels + ((size_t)view * n_particles + particle) * N_CORNERS;
    __local uint masks[CAPACITY];
    __local int order[N_PARTS], totals[N_COUNTS], box[4];
    const int4 region = roi[view];

    for (int i = lane; i < N_COUNTS; i += GROUP) totals[i] = 0;
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
        box[0] = region.z;
        box[1] = region.w;
        box[2] = region.x - 1;
        box[3] = region.y - 1;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int i = lane; i < N_VERTICES; i += GROUP) {
        const float2 p = pixels[i];
        if (p.x == FAR_OUT) continue;
        atomic_min(&box[0], (int)p.x);
        atomic_min(&box[1], (int)p.y);
        atomic_max(&box[2], (int)p.x + 1);
        atomic_max(&box[3], (int)p.y + 1);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    // The window: whole words around the part of the body that lies in the region, and a pixel
    // more on each side, so that the region's border is no edge.
    const int first_column = max(box[0], region.x) - 1, last_column = min(box[2], region.z - 1) + 1;
    const int first_row = max(box[1], region.y), last_row = min(box[3], region.w - 1);
    const int first_word = first_column >> 5, words = (last_column >> 5) - first_word + 1;
    const int rows = CAPACITY / (N_PARTS * max(words, 1)) - 2;  // of a band

    int edge_count = 0, edge_sum = 0, area[N_LABELS], overlap[N_LABELS];
    for (int l = 0; l < N_LABELS; ++l) area[l] = overlap[l] = 0;
    const int n_bands = last_row < first_row || words < 1 ? 0 : (last_row - first_row) / rows + 1;
    for (int band = 0; band < n_bands; ++band) {
        const int top = first_row + band * rows - 1;  // the row of masks' first
        const int bottom = min(top + rows + 1, last_row + 1);
        const int plane = (rows + 2) * words;
        for (int i = lane; i < N_PARTS * plane; i += GROUP) masks[i] = 0;
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int t = lane; t < N_TRIANGLES; t += GROUP) {
            const int4 triangle = triangles[t];
            const float2 a = pixels[triangle.x], b = pixels[triangle.y], c = pixels[triangle.z];
            if (a.x == FAR_OUT || b.x == FAR_OUT || c.x == FAR_OUT) continue;
            const int from = max(top, (int)ceil(fmin(fmin(a.y, b.y), c.y)));
            const int to = min(bottom, (int)floor(fmax(fmax(a.y, b.y), c.y)));
            for (int row = from; row <= to; ++row) {
                float low = 2 * FAR_OUT, high = -2 * FAR_OUT;
                widen(a, b, row, &low, &high);
                widen(b, c, row, &low, &high);
                widen(c, a, row, &low, &high);
                const int first = max((int)ceil(low), first_column);
                const int last = min((int)floor(high), last_column);
                if (first > last) continue;
                const int at = triangle.w * plane + (row - top) * words - first_word;
                for (int word = first >> 5; word <= last >> 5; ++word)
                    atomic_or(&masks[at + word], bits_between(first, last + 1, word));
            }
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        const int n_cells = (min(rows, last_row - top) * words);
        for (int i = lane; i < n_cells; i += GROUP) {
            const int row = top + 1 + i / words, word = first_word + i % words;
            const uint regarded = bits_between(region.x, region.z, word);
            uint covered = ~regarded, edges = 0;
            for (int k = 0; regarded && k < N_PARTS; ++k) {
                const int p = order[k];
                __local const uint *mask = masks + p * plane + (row - top) * words;
                const uint seen = mask[word - first_word] & ~covered;
                if (!seen) continue;
                covered |= seen;
                if (labels[p].y) edges |= seen & ~inner_bits(mask, words, word - first_word);
#if N_LABELS > 1
                const int label = labels[p].x;
                const size_t at = ((size_t)view * N_LABELS + label) * WORDS + word;
                area[label] += popcount(seen);
                overlap[label] += popcount(seen & silhouettes[at * pitch + row]);
#endif
#ifdef DRAW
                const size_t at_row = ((size_t)particle * get_num_groups(1) + view) * height + row;
                for (int bit = 0; bit < 32; ++bit)
                    if (seen >> bit & 1)
                        pictures[at_row * WIDTH + 32 * word + bit] =
                            (uchar2)(p + 1, edges >> bit & 1 ? 255 : 0);
#endif
            }
            if (!regarded) continue;
            const size_t at_row = (size_t)view * height + row;
#if N_LABELS == 1
            covered &= regarded;
            area[0] += popcount(covered);
            const size_t at = (size_t)view * WORDS + word;
            overlap[0] += popcount(covered & silhouettes[at * pitch + row]);
#endif
            edge_count += popcount(edges);
            for (; edges; edges &= edges - 1)
                edge_sum += proximity[at_row * WIDTH + 32 * word + 31 - clz(edges & -edges)];
        }
        barrier(CLK_LOCAL_MEM_FENCE);
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

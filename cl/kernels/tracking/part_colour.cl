// What colours the parts of a body have; twin: reference/likelihood/part_colour.py.
// Colours are codes: numbers of the nearest of a palette's colours, NO_CODE outside the silhouettes,
// HIDDEN_CODE inside where the person is hidden.
// Defines: those of kinematics.h, PACK 1; N_CODES, at most 256; N_PARTS; ROWS and COLUMNS of samples
// on a cone; RATIO_STEPS; STRIP.
#if !defined(CAMERA_FLOATS) || !defined(COLUMNS) || !defined(FAR_OUT) || !defined(N_CODES) || \
    !defined(N_PARTS) || !defined(RATIO_STEPS) || !defined(ROWS) || !defined(STRIP)
#error "tracking/part_colour.cl needs CAMERA_FLOATS, COLUMNS, FAR_OUT, N_CODES, N_PARTS, RATIO_STEPS, ROWS and STRIP"
#endif
#include "common/camera.h"
#include "common/cones.h"
#include "common/kinematics.h"
#include "tracking/codes.h"

// Codes (V, H, W) of pictures (V, H, W, 3) BGR inside the silhouettes, the first channel of maps
// (V, H, W, 2); palette: the code of every colour of 5 bits per channel. An item has STRIP pixels:
// most strips show nobody.
__kernel void encode_colours(int n_pixels, __global const uchar *maps,
                             __global const uchar *pictures, __global const uchar *palette,
                             __global uchar *codes)
{
    const int first = STRIP * get_global_id(0), end = min(first + STRIP, n_pixels);
    uchar any = 0;
    for (int at = first; at < end; ++at) {
        any |= maps[2 * (size_t)at];
        codes[at] = NO_CODE;
    }
    for (int at = any ? first : end; at < end; ++at) {
        const uchar shown = maps[2 * (size_t)at];
        if (shown == 254) codes[at] = HIDDEN_CODE;
        if (shown != 255) continue;
        const uchar3 colour = vload3(at, pictures);
        codes[at] = palette[(colour.x >> 3) << 10 | (colour.y >> 3) << 5 | colour.z >> 3];
    }
}

// Signs by which a point tells which side of the line from `a` to `b` it is on.
static inline float side_of(float2 a, float2 b, float2 point)
{
    return (b.x - a.x) * (point.y - a.y) - (b.y - a.y) * (point.x - a.x);
}

// Whether a pixel lies in the trapezoid with these corners; an outline without image has none.
INLINED bool within_corners(__local const float2 *corners, float2 pixel)
{
    if (!(corners[0].x > -FAR_OUT)) return false;
    float low = 0.0f, high = 0.0f;
    for (int i = 0; i < 4; ++i) {
        const float side = side_of(corners[i], corners[(i + 1) % 4], pixel);
        low = fmin(low, side);
        high = fmax(high, side);
    }
    return low >= 0.0f || high <= 0.0f;
}

// Adds to counts (N_PARTS, N_CODES) the codes of samples on all cones of the first of `poses`,
// ROWS along and COLUMNS across each: of those that no other cone lies before
// or behind, so that a limb that is taken for another, or hidden, teaches nothing. One work-group
// per camera. row_parts: (N_CONES, ROWS), -1 for cones that are not looked for in the images.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void count_colours(int width, int height, __global const float *cameras,
                   __global const float *poses, __global const float *table,
                   __global const int *row_parts,
                   __global const uchar *codes, __global int *counts)
{
    __local vfloat turns[2 * N_DOF], frames[N_BONES * FRAME_FLOATS];
    __local vfloat cones[N_CONES * CONE_FLOATS];
    __local float body[BODY_FLOATS];
    __local float2 corners[4 * N_CONES];
    const int lane = get_local_id(0), view = get_group_id(0);
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    take_body(table, body);
    take_pose(poses, 0, 1, body, turns);
    pose_bones(turns, body, frames, 0);
    place_cones(body, frames, cones);
    for (int c = lane; c < N_CONES; c += GROUP) {
        float3 ends[4];
        cone_corners(vload16(c, cones), vload3(0, camera + 25), ends);
        bool seen = true;
        for (int i = 0; i < 4; ++i) {
            float2 pixel;
            const float depth = camera_project(camera, ends[i].x, ends[i].y, ends[i].z, &pixel);
            seen &= depth > 0.0f && fabs(pixel.x) < FAR_OUT && fabs(pixel.y) < FAR_OUT;
            corners[4 * c + i] = pixel;
        }
        if (!seen) corners[4 * c] = (float2)(-2.0f * FAR_OUT);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int item = lane; item < N_CONES * ROWS * COLUMNS; item += GROUP) {
        const int row = item / COLUMNS, c = row / ROWS, part = row_parts[row];
        __local const float2 *own = corners + 4 * c;
        if (part < 0 || !(own[0].x > -FAR_OUT)) continue;
        const float t = (row % ROWS + 0.5f) / ROWS, u = (item % COLUMNS + 0.5f) / COLUMNS;
        const float2 left = own[0] + t * (own[3] - own[0]);
        const float2 right = own[1] + t * (own[2] - own[1]);
        const float2 pixel = left + u * (right - left);
        const int at = camera_offset(camera, pixel, width);
        if (at < 0) continue;
        bool alone = true;
        for (int other = 0; other < N_CONES && alone; ++other)
            alone = other == c || !within_corners(corners + 4 * other, pixel);
        const int code = codes[(size_t)view * width * height + at];
        if (alone && code < HIDDEN_CODE)
            atomic_inc(counts + part * N_CODES + code);
    }
}

// Sum of `value` over the work-group's N_CODES items.
INLINED float total(float value, __local float *sums)
{
    const int lane = get_local_id(0);
    sums[lane] = value;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int half_size = N_CODES / 2; half_size > 0; half_size /= 2) {
        if (lane < half_size) sums[lane] += sums[lane + half_size];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    const float sum = sums[0];
    barrier(CLK_LOCAL_MEM_FENCE);
    return sum;
}

// Moves histograms (N_PARTS, N_CODES) on by the counts, which it clears, and makes of them ratios
// (N_PARTS, N_CODES): the log of how much likelier each code is on the part than on the mean part,
// RATIO_STEPS at `bound` and beyond; less for parts of fewer than `least` samples. decay: what
// histograms keep. rare: added to likelihoods. One work-group, of an item per code.
__kernel __attribute__((reqd_work_group_size(N_CODES, 1, 1)))
void learn_colours(float decay, float rare, float bound, float least, __global int *counts,
                   __global float *histograms, __global char *ratios)
{
    __local float sums[N_CODES];
    const int code = get_local_id(0);
    float share[N_PARTS], weight[N_PARTS], mean = 0.0f, n_known = 0.0f;
    for (int part = 0; part < N_PARTS; ++part) {
        const int at = part * N_CODES + code;
        const float value = decay * histograms[at] + (float)counts[at];
        histograms[at] = value;
        counts[at] = 0;
        const float sum = total(value, sums);
        share[part] = value / fmax(sum, 1.0f);
        weight[part] = fmin(sum / least, 1.0f);
        mean += share[part];
        n_known += sum > 0.0f ? 1.0f : 0.0f;
    }
    mean /= fmax(n_known, 1.0f);
    for (int part = 0; part < N_PARTS; ++part) {
        const float ratio = log((share[part] + rare) / (mean + rare)) * weight[part] / bound;
        const float step = rint(RATIO_STEPS * clamp(ratio, -1.0f, 1.0f));
        ratios[part * N_CODES + code] = code < HIDDEN_CODE ? (char)step : 0;
    }
}

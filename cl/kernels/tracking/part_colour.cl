// What colour each part of the body has, and how badly poses go with it; twin:
// reference/likelihood/part_colour.py. Defines: those of kinematics.h; DARK, grey levels;
// LEAST_SAMPLES.
#if !defined(DARK) || !defined(LEAST_SAMPLES) || !defined(PACK)
#error "tracking/part_colour.cl needs DARK, LEAST_SAMPLES and PACK"
#endif
#include "common/packed_cones.h"
#include "common/reduction.h"

// Chromaticities of the surface samples, which sample_surface (likelihood.cl) took: x, y, 1 where a
// camera sees the voxel, 0. colours: RGB of the surface voxels, and how many cameras see them.
__kernel void sample_colours(int n_points, __global const int *count,
                             __global const uchar4 *colours, __global float4 *samples)
{
    const int k = get_global_id(0);
    if (k >= n_points) return;
    float4 sample = (float4)(0.0f);
    if (count[0] > 0) {
        const uchar4 colour = colours[(int)((long)k * count[0] / n_points)];
        const float r = colour.x, g = colour.y, b = colour.z, sum = r + g + b + DARK;
        // Orthonormal axes of the plane R + G + B = 0.
        if (colour.w > 0)
            sample = (float4)(0.70710678f * (r - g) / sum, 0.40824829f * (r + g - 2.0f * b) / sum,
                              1.0f, 0.0f);
    }
    samples[k] = sample;
}

// What it costs (n_points, N_CONES) if a sample lies on a part: d^2 / (d^2 + scale^2), d between
// their chromaticities; 0 where one of them is not known.
__kernel void compare_colours(int n_points, float scale, __global const float4 *samples,
                              __global const float4 *parts, __global float *costs)
{
    const int c = get_global_id(0), k = get_global_id(1);
    if (c >= N_CONES || k >= n_points) return;
    const float4 sample = samples[k], part = parts[c];
    const float x = (sample.x - part.x) / scale, y = (sample.y - part.y) / scale;
    const float d2 = x * x + y * y;
    costs[k * N_CONES + c] = sample.z > 0.0f && part.z > 0.0f ? d2 / (1.0f + d2) : 0.0f;
}

// Adds to the errors `weight` times the mean cost of the samples (every `stride`-th from `first`)
// that a camera sees, each at the part whose surface is nearest to it. One work-group per pack of
// particles.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void add_colour_errors(int n_particles, __global const float *poses, __global const float *table,
                       int n_points, int first_point, int stride, float weight,
                       __global const float4 *points, __global const float4 *samples,
                       __global const float *costs, __global float *errors)
{
    __local vfloat turns[2 * N_DOF], frames[N_BONES * FRAME_FLOATS];
    __local vfloat cones[N_CONES * CONE_FLOATS] __attribute__((aligned(64)));
    __local vfloat spans[N_CONES * SPAN_FLOATS] __attribute__((aligned(64)));
    __local float body[BODY_FLOATS], numbers[GROUP];
    __local vfloat sums[GROUP];
    const int lane = get_local_id(0), first = get_group_id(0) * PACK;
    take_cones(table, poses, first, n_particles, body, turns, frames, cones, spans);

    const int n = (n_points + stride - 1) / stride;
    vfloat sum = 0.0f;
    float number = 0.0f;
    for (int i = lane; i < n; i += GROUP) {
        const int at = first_point + i * stride;
        const int k = at < n_points ? at : at - n_points;
        if (samples[k].z == 0.0f) continue;
        const float4 point = points[k];
        const vpoint here = {point.x, point.y, point.z};
        vfloat nearest = 1e6f, cost = 0.0f;
        for (int c = 0; c < N_CONES; ++c) {
            const vfloat d =
                packed_distance(cones + c * CONE_FLOATS, spans + c * SPAN_FLOATS, here);
            const vfloat away = d < 0.0f ? -d : d, here_cost = costs[k * N_CONES + c];
            cost = away < nearest ? here_cost : cost;
            nearest = least(nearest, away);
        }
        sum += cost;
        number += 1.0f;
    }
    sums[lane] = sum;
    numbers[lane] = number;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int half_size = GROUP / 2; half_size > 0; half_size /= 2) {
        if (lane < half_size) {
            sums[lane] += sums[lane + half_size];
            numbers[lane] += numbers[lane + half_size];
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (lane == 0 && numbers[0] > 0.0f) {
        float lanes[PACK];
        STORE_PACK(sums[0] * (weight / numbers[0]), lanes);
        for (int l = 0; l < PACK && first + l < n_particles; ++l) errors[first + l] += lanes[l];
    }
}

// The part nearest to every sample in one pose, and how much the sample says about its colour:
// scale^2 / (d^2 + scale^2), d the distance to its surface; 0 where no camera sees the sample.
// One work-group.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void find_nearest_parts(__global const float *pose, __global const float *table, int n_points,
                        float scale, __global const float4 *points,
                        __global const float4 *samples, __global float2 *nearest_parts)
{
    __local vfloat turns[2 * N_DOF], frames[N_BONES * FRAME_FLOATS];
    __local vfloat cones[N_CONES * CONE_FLOATS] __attribute__((aligned(64)));
    __local vfloat spans[N_CONES * SPAN_FLOATS] __attribute__((aligned(64)));
    __local float body[BODY_FLOATS];
    take_cones(table, pose, 0, 1, body, turns, frames, cones, spans);

    for (int k = get_local_id(0); k < n_points; k += GROUP) {
        const float4 point = points[k];
        const vpoint here = {point.x, point.y, point.z};
        float nearest = 1e6f, part = 0.0f;
        for (int c = 0; c < N_CONES; ++c) {
            const vfloat distance =
                packed_distance(cones + c * CONE_FLOATS, spans + c * SPAN_FLOATS, here);
            const float away = fabs(LANE_OF(distance, 0));  // all lanes are of the same pose
            part = away < nearest ? c : part;
            nearest = away < nearest ? away : nearest;
        }
        const float ratio = nearest / scale;
        nearest_parts[k] = (float2)(part, samples[k].z / (1.0f + ratio * ratio));
    }
}

// Moves every part's colour towards the mean of the samples nearest to it by the share `rate`; all
// the way if it was not known. One work-group per part.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void learn_colours(int n_points, float rate, __global const float4 *samples,
                   __global const float2 *nearest_parts, __global float4 *parts)
{
    __local float scratch[GROUP];
    const int part = get_group_id(0), lane = get_local_id(0);
    float x = 0.0f, y = 0.0f, weight = 0.0f;
    for (int k = lane; k < n_points; k += GROUP) {
        const float2 nearest = nearest_parts[k];
        const float mine = (int)nearest.x == part ? nearest.y : 0.0f;
        x += mine * samples[k].x;
        y += mine * samples[k].y;
        weight += mine;
    }
    x = group_sum(scratch, x);
    y = group_sum(scratch, y);
    weight = group_sum(scratch, weight);
    if (lane == 0 && weight >= LEAST_SAMPLES) {
        const float4 known = parts[part];
        const float share = known.z > 0.0f ? rate : 1.0f;
        parts[part] = (float4)(known.x + share * (x / weight - known.x),
                               known.y + share * (y / weight - known.y), 1.0f, 0.0f);
    }
}

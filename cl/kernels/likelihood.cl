// How badly the cones of every particle fit the voxels; twin: reference/likelihood.py.
// Define: N_CONES.
#include "camera.h"
#include "cones.h"

// Corners further out than this, px, count as unseen: in float the lines between them would be off
// by more than a hundredth of a pixel, at 1e9 px by whole pictures.
#define FAR_OUT 1e5f

// Song et al. eq. (14)-(15), one work-item per particle, cone and view: sums of (1 - p) and counts
// over samples of the trapezoid that the cone shows. maps: (V, height, width) uchar2, silhouette
// and edge proximity. sampling: rows along the cone, columns across it. sums: (V, N, C) float4 =
// edge error, edge samples, silhouette error, silhouette samples.
__kernel void score_images(int n_particles, int width, int height,
                           __global const float *cones, __global const float *cameras,
                           __global const uchar2 *maps, __global const int2 *sampling,
                           __global float4 *sums)
{
    const int id = get_global_id(0), view = get_global_id(1);
    if (id >= n_particles * N_CONES) return;
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    __global const uchar2 *map = maps + view * width * height;

    float3 corners[4];
    cone_corners(cones + id * CONE_FLOATS, vload3(0, camera + 25), corners);
    float2 pixels[4];
    bool seen = true;
    for (int i = 0; i < 4; ++i) {
        seen &= camera_project(camera, corners[i].x, corners[i].y, corners[i].z, &pixels[i]) > 0;
        seen &= all(fabs(pixels[i]) < FAR_OUT);
    }

    int edge_error = 0, edge_count = 0, inner_error = 0, inner_count = 0;
    const int2 n = seen ? sampling[id % N_CONES] : (int2)(0, 0);
    for (int row = 0; row < n.x; ++row) {
        const float t = (row + 0.5f) / n.x;
        const float2 left = mix(pixels[0], pixels[3], t);
        const float2 right = mix(pixels[1], pixels[2], t);
        for (int column = -1; column <= n.y; ++column) {
            // Columns -1 and n.y are the two outlines, the others lie inside.
            const bool edge = column < 0 || column == n.y;
            const float u = column < 0 ? 0.0f : column == n.y ? 1.0f : (column + 0.5f) / n.y;
            const int2 p = camera_pixel(camera, mix(left, right, u));
            if (p.x < 0) continue;
            const uchar2 value = map[p.y * width + p.x];
            if (edge) {
                edge_error += 255 - value.y;
                ++edge_count;
            } else {
                inner_error += 255 - value.x;
                ++inner_count;
            }
        }
    }
    sums[view * n_particles * N_CONES + id] =
        (float4)(edge_error / 255.0f, edge_count, inner_error / 255.0f, inner_count);
}

// Every (count / n_points)-th surface voxel's centre, so that their number is the same in every
// frame; points.w is 0 when there is no voxel at all.
__kernel void sample_surface(int n_points, __global const int *count,
                             __global const int *surface, int ny, int nz, float4 origin_size,
                             __global float4 *points)
{
    const int k = get_global_id(0);
    if (k >= n_points) return;
    if (count[0] == 0) {
        points[k] = (float4)(0.0f);
        return;
    }
    const int index = surface[(int)((long)k * count[0] / n_points)];
    const float3 ijk = (float3)(index / (ny * nz), index / nz % ny, index % nz);
    points[k] = (float4)(origin_size.xyz + (ijk + 0.5f) * origin_size.w, 1.0f);
}

// Mean over the sampled surface voxels of d^2 / (d^2 + scale^2), d the distance to the nearest
// cone's surface (Geman & McClure 1987): 0 when all are explained, 1 when none is. One work-group
// per particle.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void score_surface(int n_points, float scale, __global const float4 *points,
                   __global const float *cones, __global float *errors)
{
    const int particle = get_group_id(0), lane = get_local_id(0);
    __local float local_cones[N_CONES * CONE_FLOATS];
    __local float partial[GROUP];
    for (int i = lane; i < N_CONES * CONE_FLOATS; i += GROUP)
        local_cones[i] = cones[particle * N_CONES * CONE_FLOATS + i];
    barrier(CLK_LOCAL_MEM_FENCE);

    float sum = 0.0f;
    for (int k = lane; k < n_points; k += GROUP) {
        float nearest = 1e6f;
        for (int c = 0; c < N_CONES; ++c)
            nearest = fmin(nearest, fabs(CONE_DISTANCE(local_cones + c * CONE_FLOATS,
                                                       points[k].xyz)));
        const float ratio = nearest / scale;
        sum += points[k].w > 0.0f ? ratio * ratio / (1.0f + ratio * ratio) : 1.0f;
    }
    partial[lane] = sum;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int half_size = GROUP / 2; half_size > 0; half_size /= 2) {
        if (lane < half_size) partial[lane] += partial[lane + half_size];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (lane == 0) errors[particle] = partial[0] / n_points;
}

// How deep the parts that must not meet lie in each other: mean over `pairs` (first, second cone)
// and three points of the first's axis of (overlap / radius)^2, at most 1 each.
inline float overlap_error(__global const float *cones, int n_pairs, __global const int2 *pairs)
{
    float sum = 0.0f;
    for (int i = 0; i < n_pairs; ++i) {
        __global const float *first = cones + pairs[i].x * CONE_FLOATS;
        __global const float *second = cones + pairs[i].y * CONE_FLOATS;
        for (int j = 0; j < 3; ++j) {
            const float t = 0.5f * j;
            const float3 point = mix(vload3(0, first), vload3(0, first + 4), t);
            const float radius = mix(first[3], first[7], t);
            const float depth = clamp(1.0f - CONE_DISTANCE(second, point) / radius, 0.0f, 1.0f);
            sum += depth * depth;
        }
    }
    return n_pairs ? sum / (3 * n_pairs) : 0.0f;
}

// The exponent of Song et al. eq. (16) with its sign put right: the sum over cameras of edge and
// silhouette error, to which surface and overlap error are added once per camera. Cameras that
// see no sample are replaced by the mean of the others; if no camera sees any, by the worst.
__kernel void total_errors(int n_particles, int n_views, int n_pairs, float4 weights,
                           __global const float *cones, __global const int2 *pairs,
                           __global const float4 *sums, __global const float *surface_errors,
                           __global float *errors)
{
    const int particle = get_global_id(0);
    if (particle >= n_particles) return;
    float error = 0.0f;
    int seeing = 0;
    for (int view = 0; view < n_views; ++view) {
        float4 total = (float4)(0.0f);
        for (int c = 0; c < N_CONES; ++c)
            total += sums[(view * n_particles + particle) * N_CONES + c];
        if (total.y == 0.0f || total.w == 0.0f) continue;
        error += weights.x * total.x / total.y + weights.y * total.z / total.w;
        ++seeing;
    }
    error = seeing ? error / seeing : weights.x + weights.y;
    error += weights.z * surface_errors[particle];
    error += weights.w * overlap_error(cones + particle * N_CONES * CONE_FLOATS, n_pairs, pairs);
    errors[particle] = n_views * error;
}

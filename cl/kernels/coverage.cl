// How much of what the cameras see of the surface voxels the body covers; twin:
// reference/coverage.py. Defines: GROUP, N_CONES.
#include "camera.h"
#include "cones.h"
#include "reduction.h"

// Further out than any picture, and where `cone_seen` puts a cone that has no image.
#define NOWHERE_SEEN -1e6f
#define OUTSIDE 1e5f

// Pixels (V, K) of the surface samples; NOWHERE_SEEN for those outside of a picture and for none.
__kernel void project_points(int n_points, int n_views, __global const float4 *points,
                             __global const float *cameras, __global float2 *pixels)
{
    const int k = get_global_id(0), view = get_global_id(1);
    if (k >= n_points || view >= n_views) return;
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    const float4 point = points[k];
    float2 pixel;
    const float depth = camera_project(camera, point.x, point.y, point.z, &pixel);
    const bool seen = point.w > 0.0f && depth > 0.0f && pixel.x >= -0.5f && pixel.y >= -0.5f &&
                      pixel.x < camera[23] - 0.5f && pixel.y < camera[24] - 0.5f;
    pixels[view * n_points + k] = seen ? pixel : (float2)(NOWHERE_SEEN);
}

// Corners of the trapezoid that a cone shows to a camera, px; all NOWHERE_SEEN if one is unseen.
inline void cone_seen(__global const float *cone, __global const float *camera,
                      __local float2 *corners)
{
    float3 world[4];
    cone_corners(cone, vload3(0, camera + 25), world);
    float2 found[4];
    bool seen = true;
    for (int i = 0; i < 4; ++i) {
        seen &= camera_project(camera, world[i].x, world[i].y, world[i].z, &found[i]) > 0.0f;
        seen &= fabs(found[i].x) < OUTSIDE && fabs(found[i].y) < OUTSIDE;
    }
    for (int i = 0; i < 4; ++i) corners[i] = seen ? found[i] : (float2)(NOWHERE_SEEN);
}

// Whether a pixel lies within a trapezoid, whichever way round its corners go.
inline bool within_corners(__local const float2 *corners, float2 pixel)
{
    bool left = true, right = true;
    for (int i = 0; i < 4 && (left || right); ++i) {  // most pixels are far from most parts
        const float2 from = corners[i], to = corners[(i + 1) % 4];
        const float side = (to.x - from.x) * (pixel.y - from.y) -
                           (to.y - from.y) * (pixel.x - from.x);
        left &= side > 0.0f;
        right &= side < 0.0f;
    }
    return left || right;
}

// Adds to the errors, once per camera, `weight` times the mean over the cameras of the share of
// samples (every `stride`-th from `first` on) that lie in no part's trapezoid; cameras that see
// none are left out. cones: (N, C, 16) posed. One work-group per particle.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void add_uncovered(int n_points, int first, int stride, int n_views, float weight,
                   __global const float *cones, __global const float *cameras,
                   __global const float2 *pixels, __global float *errors)
{
    const int particle = get_group_id(0), lane = get_local_id(0);
    const int n = (n_points + stride - 1) / stride;
    __local float2 corners[N_CONES * 4];
    __local float scratch[GROUP];
    float sum = 0.0f, seeing = 0.0f;
    for (int view = 0; view < n_views; ++view) {
        for (int c = lane; c < N_CONES; c += GROUP)
            cone_seen(cones + (particle * N_CONES + c) * CONE_FLOATS,
                      cameras + view * CAMERA_FLOATS, corners + 4 * c);
        barrier(CLK_LOCAL_MEM_FENCE);
        float seen = 0.0f, uncovered = 0.0f;
        for (int k = lane; k < n; k += GROUP) {
            const float2 pixel = pixels[view * n_points + (first + k * stride) % n_points];
            if (pixel.x == NOWHERE_SEEN) continue;
            bool covered = false;
            for (int c = 0; c < N_CONES && !covered; ++c)
                covered = within_corners(corners + 4 * c, pixel);
            seen += 1.0f;
            uncovered += covered ? 0.0f : 1.0f;
        }
        seen = group_sum(scratch, seen);
        uncovered = group_sum(scratch, uncovered);
        sum += seen > 0.0f ? uncovered / seen : 0.0f;
        seeing += seen > 0.0f ? 1.0f : 0.0f;
    }
    if (lane == 0) errors[particle] += n_views * weight * (seeing > 0.0f ? sum / seeing : 1.0f);
}

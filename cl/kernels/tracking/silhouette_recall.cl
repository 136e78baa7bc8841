// How much of what the cameras see of the surface voxels the body covers; twin:
// reference/likelihood/voxel.py. Defines: GROUP and that of pack.h, whose packs are of
// samples here; VIEWS, the cameras that a work-group looks at together, which divides GROUP;
// N_CONES.
#if !defined(CAMERA_FLOATS) || !defined(CONE_FLOATS) || !defined(FAR_OUT) || !defined(GROUP) || \
    !defined(N_CONES) || !defined(PACK) || !defined(VIEWS)
#error "tracking/silhouette_recall.cl needs CAMERA_FLOATS, CONE_FLOATS, FAR_OUT, GROUP, N_CONES, PACK and VIEWS"
#endif
#include "common/camera.h"
#include "common/cones.h"

// Items that look at one camera's samples, a power of two.
#define VIEW_LANES (GROUP / VIEWS)

// Further out than any picture, and where samples are that have no image.
#define NOWHERE_SEEN -1e6f

// Every (count / n_points)-th surface voxel's centre, so that their number K is the same in every
// frame; points.w is 0 when there is no voxel at all. And their pixels (V, K): NOWHERE_SEEN for those
// outside of a picture and for none.
__kernel void sample_surface(int n_points, int n_views, __global const int *count,
                             __global const int *surface, int ny, int nz, float4 origin_size,
                             __global const float *cameras, __global float4 *points,
                             __global float2 *pixels)
{
    const int first = get_global_id(0) * PACK, n = *count;
    if (first >= n_points) return;
    for (int l = 0; l < PACK && first + l < n_points; ++l) {
        const int index = n > 0 ? surface[(int)((long)(first + l) * n / n_points)] : 0;
        const float3 ijk = (float3)(index / (ny * nz), index / nz % ny, index % nz);
        points[first + l] = n > 0 ? (float4)(origin_size.xyz + (ijk + 0.5f) * origin_size.w, 1.0f)
                                  : (float4)(0.0f);
    }
#define POINT(l) points[lane_index(first, 0x##l, n_points)]
#define X(l) POINT(l).x
#define Y(l) POINT(l).y
#define Z(l) POINT(l).z
    const vfloat px = PACK_OF(vfloat, X), py = PACK_OF(vfloat, Y), pz = PACK_OF(vfloat, Z);
#undef X
#undef Y
#undef Z
#undef POINT
    for (int view = 0; view < n_views; ++view) {
        __global const float *camera = cameras + view * CAMERA_FLOATS;
        vfloat x, y;
        const vfloat depth = camera_project_pack(camera, px, py, pz, &x, &y);
        const vint seen = (vint)(n > 0 ? -1 : 0) & (depth > 0.0f) & (x >= -0.5f) & (y >= -0.5f) &
                          (x < camera[23] - 0.5f) & (y < camera[24] - 0.5f);
        float xs[PACK], ys[PACK];
        STORE_PACK(seen ? x : NOWHERE_SEEN, xs);
        STORE_PACK(seen ? y : NOWHERE_SEEN, ys);
        for (int l = 0; l < PACK && first + l < n_points; ++l)
            pixels[view * n_points + first + l] = (float2)(xs[l], ys[l]);
    }
}

// The edges of the trapezoid that a cone shows to a camera: three times four numbers a, b, c, of
// which a x + b y + c tells the side of each edge that a pixel is on, positive for the inner one
// whichever way round the corners go; 0 if a corner is unseen.
INLINED void cone_edges(__global const float *cone, __global const float *camera,
                        __local float4 *edges)
{
    float3 corners[4];
    cone_corners(vload16(0, cone), vload3(0, camera + 25), corners);
    float depth[4 + PACK], px[4 + PACK], py[4 + PACK];
    for (int i = 0; i < 4; i += PACK) {
#define X(l) corners[(i + 0x##l) % 4].x
#define Y(l) corners[(i + 0x##l) % 4].y
#define Z(l) corners[(i + 0x##l) % 4].z
        vfloat x, y;
        const vfloat z = camera_project_pack(camera, PACK_OF(vfloat, X), PACK_OF(vfloat, Y),
                                             PACK_OF(vfloat, Z), &x, &y);
        STORE_PACK(z, depth + i);
        STORE_PACK(x, px + i);
        STORE_PACK(y, py + i);
#undef X
#undef Y
#undef Z
    }
    bool seen = true;
    for (int i = 0; i < 4; ++i)
        seen &= depth[i] > 0.0f && fabs(px[i]) < FAR_OUT && fabs(py[i]) < FAR_OUT;
    const float4 x = vload4(0, px), y = vload4(0, py);
    const float area = (x.z - x.x) * (y.w - y.y) - (x.w - x.y) * (y.z - y.x);
    const float4 a = sign(area) * (y - y.yzwx), b = sign(area) * (x.yzwx - x);
    edges[0] = seen ? a : (float4)(0.0f);
    edges[1] = seen ? b : (float4)(0.0f);
    edges[2] = seen ? -(a * x + b * y) : (float4)(0.0f);
}

// Positive for the pixels that lie within a trapezoid.
INLINED vfloat within_edges(__local const float4 *edges, vfloat x, vfloat y)
{
    const float4 a = edges[0], b = edges[1], c = edges[2];
    const vfloat first = a.x * x + (b.x * y + c.x), second = a.y * x + (b.y * y + c.y);
    const vfloat third = a.z * x + (b.z * y + c.z), fourth = a.w * x + (b.w * y + c.w);
    return least(least(first, second), least(third, fourth));
}

// Adds to the errors, once per camera, `weight` times the mean over the cameras of the share of
// samples (every `stride`-th from `first_point` on) that lie in no part's trapezoid; cameras that
// see none are left out. cones: (N, C, 16) posed. One work-group per particle.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void add_uncovered(int n_points, int first_point, int stride, int n_views, float weight,
                   __global const float *cones, __global const float *cameras,
                   __global const float2 *pixels, __global float *errors)
{
    __local float4 edges[VIEWS * N_CONES * 3];
    __local float seen[GROUP], uncovered[GROUP];
    const int particle = get_group_id(0), lane = get_local_id(0);
    const int view = lane / VIEW_LANES, view_lane = lane % VIEW_LANES;
    const int n = (n_points + stride - 1) / stride;
    cones += particle * N_CONES * CONE_FLOATS;
    float sum = 0.0f, seeing = 0.0f;
    for (int begin = 0; begin < n_views; begin += VIEWS) {
        const int here = n_views - begin < VIEWS ? n_views - begin : VIEWS;
        for (int item = lane; item < here * N_CONES; item += GROUP)
            cone_edges(cones + item % N_CONES * CONE_FLOATS,
                       cameras + (begin + item / N_CONES) * CAMERA_FLOATS, edges + 3 * item);
        barrier(CLK_LOCAL_MEM_FENCE);
        vint n_seen = 0, n_uncovered = 0;
        __global const float2 *samples = pixels + (begin + view) * n_points;
        for (int k = view_lane * PACK; k < (view < here ? n : 0); k += VIEW_LANES * PACK) {
#define INDEX(l) (first_point + lane_index(k, 0x##l, n) * stride)
#define SAMPLE(l) samples[INDEX(l) < n_points ? INDEX(l) : INDEX(l) - n_points]
#define X(l) SAMPLE(l).x
#define Y(l) SAMPLE(l).y
#define THERE(l) (k + 0x##l < n)
            const vfloat x = PACK_OF(vfloat, X), y = PACK_OF(vfloat, Y);
            const vint there = PACK_OF(vint, THERE) & (x > NOWHERE_SEEN);
            vfloat covered = 0.0f;
            for (int c = 0; c < N_CONES; ++c)
                covered = most(covered, within_edges(edges + 3 * (view * N_CONES + c), x, y));
            n_seen += there;
            n_uncovered += covered > 0.0f ? 0 : there;
        }
        seen[lane] = PACK_SUM(TO_FLOAT(n_seen));
        uncovered[lane] = PACK_SUM(TO_FLOAT(n_uncovered));
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int half_size = VIEW_LANES / 2; half_size > 0; half_size /= 2) {
            if (view_lane < half_size) {
                seen[lane] += seen[lane + half_size];
                uncovered[lane] += uncovered[lane + half_size];
            }
            barrier(CLK_LOCAL_MEM_FENCE);
        }
        for (int v = 0; v < (lane == 0 ? here : 0); ++v) {
            const float all = seen[v * VIEW_LANES];
            sum += all > 0.0f ? uncovered[v * VIEW_LANES] / all : 0.0f;
            seeing += all > 0.0f ? 1.0f : 0.0f;
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (lane == 0) errors[particle] += n_views * weight * (seeing > 0.0f ? sum / seeing : 1.0f);
}

// Surface voxels that stand for all, and their pixels; twin: reference/likelihood/voxel.py. Defines:
// that of pack.h, whose packs are of samples here.
#if !defined(CAMERA_FLOATS) || !defined(PACK)
#error "tracking/surface_samples.cl needs CAMERA_FLOATS and PACK"
#endif
#include "common/camera.h"

// Further out than any picture: where samples are that have no image.
#define NOWHERE -1e6f

// Every (count / n_points)-th surface voxel's centre, so that their number K is the same in every
// frame; points.w is 0 when there is no voxel at all. And their pixels (V, K): NOWHERE for those
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
        STORE_PACK(seen ? x : NOWHERE, xs);
        STORE_PACK(seen ? y : NOWHERE, ys);
        for (int l = 0; l < PACK && first + l < n_points; ++l)
            pixels[view * n_points + first + l] = (float2)(xs[l], ys[l]);
    }
}

// Skinned meshes in all pictures. Twin: apf/body/mesh.py. Defines: N_VERTICES, N_CORNERS, N_BONES,
// and N_BINDS bones per vertex. A vertex past N_VERTICES is the middle of a part; its distance says
// which part hides which.
#if !defined(CAMERA_FLOATS) || !defined(CONE_FLOATS) || !defined(FAR_OUT) || !defined(N_BINDS) || \
    !defined(N_BONES) || !defined(N_CORNERS) || !defined(N_VERTICES)
#error "image/skin.cl needs CAMERA_FLOATS, CONE_FLOATS, FAR_OUT, N_BINDS, N_BONES, N_CORNERS and N_VERTICES"
#endif
#include "common/camera.h"
#include "common/cones.h"

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
    else if (depth <= 0.0f || fabs(pixel.x) >= FAR_OUT || fabs(pixel.y) >= FAR_OUT)
        pixel = (float2)(FAR_OUT, FAR_OUT);
    pixels[((size_t)view * n_particles + particle) * N_CORNERS + vertex] = pixel;
}

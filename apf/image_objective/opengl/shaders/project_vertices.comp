// Skinned meshes in all pictures; counterpart of cl/kernels/image/skin.cl. An invocation per
// vertex, pose and view; vertices past N_VERTICES are the middles of parts, of which the distance
// to the camera is kept.
#include "camera.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Frames { vec4 frames[]; };       // (N, N_BONES, 4)
layout(std430, binding = 2) writeonly buffer Pixels { vec2 pixels[]; };      // (V, N, N_CORNERS)
layout(std430, binding = 3) readonly buffer Binds { vec4 binds[]; };         // (N_CORNERS, N_BINDS)
layout(std430, binding = 4) readonly buffer BindBones { int bind_bones[]; };
uniform int n_particles;

void main()
{
    const int vertex = int(gl_GlobalInvocationID.x);
    const int particle = int(gl_GlobalInvocationID.y), view = int(gl_GlobalInvocationID.z);
    if (vertex >= N_CORNERS) return;
    vec3 point = vec3(0.0);
    for (int i = 0; i < N_BINDS; ++i) {
        const vec4 bind = binds[vertex * N_BINDS + i];
        const int bone = 4 * (particle * N_BONES + bind_bones[vertex * N_BINDS + i]);
        const vec3 origin = frames[bone].xyz;
        point += bind.w * (origin + bind.x * frames[bone + 2].xyz + bind.y * frames[bone + 3].xyz +
                           bind.z * (frames[bone + 1].xyz - origin));
    }
    vec2 pixel;
    const bool seen = project(view, point, pixel);
    if (vertex >= N_VERTICES) pixel = vec2(distance(point, camera_centre(view)), 0.0);
    else if (!seen) pixel = vec2(FAR_OUT);
    pixels[(view * n_particles + particle) * N_CORNERS + vertex] = pixel;
}

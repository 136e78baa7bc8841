// All posed cones as parts of all pictures; counterpart of cl/kernels/image/parts.cl, without round
// ends. An invocation per cone and view.
#include "camera.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Cones { vec4 cones[]; };     // (N, N_PARTS, 4)
layout(std430, binding = 2) writeonly buffer Parts { vec4 parts[]; };    // (V, N, N_PARTS, 5)
layout(std430, binding = 3) readonly buffer Edged { int edged[]; };      // (N_PARTS,)
uniform int n_cones;

// The line through two corners of the part as (a, b, c): a x + b y + c is how many neighbours of a
// pixel, along its row or its column, lie before the line. turn: of the corners, its sign.
vec3 border(vec2 p, vec2 q, float turn)
{
    const vec2 along = q - p;
    const float rise = abs(along.y) >= 1e-4 ? along.y : along.y < 0.0 ? -1e-4 : 1e-4;
    const float slope = along.x / rise;
    const float a = (turn * rise < 0.0 ? 1.0 : -1.0) / max(abs(slope), 1.0);
    return vec3(a, -a * slope, -a * (p.x - slope * p.y));
}

void main()
{
    const int id = int(gl_GlobalInvocationID.x), view = int(gl_GlobalInvocationID.y);
    if (id >= n_cones) return;
    const vec3 eye = camera_centre(view);
    const vec4 a = cones[4 * id], b = cones[4 * id + 1];
    const vec3 x = cones[4 * id + 2].xyz, y = cones[4 * id + 3].xyz;
    vec2 e = vec2(dot(eye - a.xyz, x), dot(eye - a.xyz, y));
    const float norm = length(e);
    e = norm > 1e-9 ? e / norm : vec2(0.0, 1.0);
    const vec3 side = -e.y / dot(x, x) * x + e.x / dot(y, y) * y;
    vec2 corners[4];
    bool seen = project(view, a.xyz + a.w * side, corners[0]);
    seen = project(view, a.xyz - a.w * side, corners[1]) && seen;
    seen = project(view, b.xyz - b.w * side, corners[2]) && seen;
    seen = project(view, b.xyz + b.w * side, corners[3]) && seen;

    const float radius = 0.5 * max(distance(corners[0], corners[1]),
                                   distance(corners[2], corners[3]));
    const vec2 first = 0.5 * (corners[0] + corners[1]), second = 0.5 * (corners[2] + corners[3]);
    // Seen along its axis a cone shows an end rather than its side.
    const bool bare = distance(first, second) < radius;
    const vec2 p = corners[2] - corners[0], q = corners[3] - corners[1];
    const float turn = p.x * q.y - p.y * q.x;
    const float away = distance(eye, 0.5 * (a.xyz + b.xyz));
    const int at = 5 * (view * n_cones + id);
    parts[at] = vec4(corners[0], corners[1]);
    parts[at + 1] = vec4(corners[2], corners[3]);
    parts[at + 2] = vec4(away / (1.0 + away), bare ? radius : 0.0, 0.5 * (first + second));
    parts[at + 3] = vec4(border(corners[1], corners[2], turn), seen ? 1.0 : 0.0);
    parts[at + 4] = vec4(border(corners[3], corners[0], turn), float(edged[id % N_PARTS]));
}

// Vertices of a mesh in the tiles.
#include "tiles.glsl"
layout(std430, binding = 1) readonly buffer Pixels { vec2 pixels[]; };  // (V, N, N_CORNERS)
layout(std430, binding = 2) readonly buffer Shape { ivec4 shape[]; };

vec2 pixel(int vertex) { return pixels[(first + gl_InstanceID) * N_CORNERS + vertex]; }
bool seen(vec2 p) { return p.x != FAR_OUT; }
float depth_of(int part)
{
    const float away = pixel(N_VERTICES + part).x;
    return away / (1.0 + away);
}

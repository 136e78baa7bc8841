"""The OpenGL shaders of `opengl.py`: surfaces first, then contours as lines."""

from __future__ import annotations

_COMMON = """
#version 430
layout(std430, binding=0) readonly buffer Pixels { vec2 pixels[]; };
layout(std430, binding=1) readonly buffer Parts { vec4 parts[]; };   // depth, radius, middle
layout(std430, binding=2) readonly buffer Shape { ivec4 shape[]; };
uniform int n_vertices, n_parts, columns;
uniform vec2 tile, atlas;
uniform vec2 sizes[64];
uniform int n_views, first;
out float gl_ClipDistance[4];

vec2 pixel(int vertex) { return pixels[gl_InstanceID * n_vertices + vertex]; }
vec4 part_of(int part) { return parts[gl_InstanceID * n_parts + part]; }
bool seen(vec2 p) { return !any(isnan(p)); }

void place(vec2 p, float depth)
{
    vec2 corner = tile * vec2(gl_InstanceID % columns, gl_InstanceID / columns);
    vec2 size = sizes[(first + gl_InstanceID) % n_views];
    gl_ClipDistance[0] = p.x + 0.5;
    gl_ClipDistance[1] = p.y + 0.5;
    gl_ClipDistance[2] = size.x - 0.5 - p.x;
    gl_ClipDistance[3] = size.y - 0.5 - p.y;
    gl_Position = vec4(2.0 * (corner + p + 0.5) / atlas - 1.0, 2.0 * depth - 1.0, 1.0);
}
void leave_out() { place(vec2(-9.0), 0.0); }
"""

FILL_VERTEX = (
    _COMMON
    + """
flat out vec4 disc;
flat out float number;
out vec2 here;
void main()
{
    ivec4 triangle = shape[gl_VertexID / 3];
    vec4 part = part_of(triangle.w);
    number = float(triangle.w + 1) / 255.0;
    disc = part;
    here = pixel(triangle[gl_VertexID % 3]);
    if (seen(pixel(triangle.x)) && seen(pixel(triangle.y)) && seen(pixel(triangle.z)))
        place(here, part.x);
    else
        leave_out();
}
"""
)

FILL_FRAGMENT = """
#version 430
flat in vec4 disc;
flat in float number;
in vec2 here;
uniform int edged[256];
out vec2 colour;
void main()
{
    float away = distance(here, disc.zw);
    if (disc.y > 0.0 && away > disc.y) discard;
    bool rim = disc.y > 0.0 && away > disc.y - 1.0 && edged[int(round(number * 255.0)) - 1] != 0;
    colour = vec2(number, rim ? 1.0 : 0.0);
}
"""

LINE_VERTEX = (
    _COMMON
    + """
layout(std430, binding=3) readonly buffer Owners { int owners[]; };
float side(vec2 a, vec2 b, vec2 p) { return (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x); }
void main()
{
    int line = gl_VertexID / 2;
    ivec4 ends = shape[line];
    vec2 a = pixel(ends.x), b = pixel(ends.y);
    vec4 part = part_of(owners[line]);
    // A contour: both surfaces that meet here lie on one side of it.
    bool contour = ends.z < 0 || side(a, b, pixel(ends.z)) * side(a, b, pixel(ends.w)) > 0.0;
    if (contour && part.y == 0.0 && seen(a) && seen(b))
        place(gl_VertexID % 2 == 0 ? a : b, part.x - 1e-6);
    else
        leave_out();
}
"""
)

LINE_FRAGMENT = """
#version 430
out vec2 colour;
void main() { colour = vec2(0.0, 1.0); }
"""

// Lines of a mesh: two ends and the third corners of the triangles on both sides, or -1. Contours
// alone are drawn: both surfaces that meet there lie on one side.
#include "mesh.glsl"
layout(std430, binding = 3) readonly buffer Owners { int owners[]; };

float side(vec2 a, vec2 b, vec2 p)
{
    return (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x);
}

void main()
{
    const int line = gl_VertexID / 2;
    const ivec4 ends = shape[line];
    const vec2 a = pixel(ends.x), b = pixel(ends.y);
    const bool contour =
        ends.z < 0 || side(a, b, pixel(ends.z)) * side(a, b, pixel(ends.w)) > 0.0;
    // Nearer than the part's own surface.
    if (contour && seen(a) && seen(b))
        place(gl_VertexID % 2 == 0 ? a : b, depth_of(owners[line]) - 1e-6);
    else
        leave_out();
}

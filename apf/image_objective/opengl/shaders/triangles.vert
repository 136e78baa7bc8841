// Triangles of a mesh: three vertices and the part.
#include "mesh.glsl"
flat out float number;

void main()
{
    const ivec4 triangle = shape[gl_VertexID / 3];
    number = float(triangle.w + 1) / 255.0;
    if (seen(pixel(triangle.x)) && seen(pixel(triangle.y)) && seen(pixel(triangle.z)))
        place(pixel(triangle[gl_VertexID % 3]), depth_of(triangle.w));
    else
        leave_out();
}

// The parts of place_parts.comp, two triangles each.
#include "tiles.glsl"
layout(std430, binding = 1) readonly buffer Parts { vec4 parts[]; };
flat out vec4 disc;              // radius or 0, its middle, whether the part has edges
flat out float number;
noperspective out vec4 here;     // the pixel, and how far it lies inside of both long sides

void main()
{
    const int corners[6] = int[](0, 1, 2, 0, 2, 3);
    const int part = gl_VertexID / 6, corner = corners[gl_VertexID % 6];
    const int at = 5 * ((first + gl_InstanceID) * N_PARTS + part);
    const vec4 two = parts[at + corner / 2], shape = parts[at + 2];
    const vec4 one_side = parts[at + 3], other_side = parts[at + 4];
    const vec2 square = vec2(corner == 1 || corner == 2 ? 1.0 : -1.0, corner >= 2 ? 1.0 : -1.0);
    const vec2 p = shape.y > 0.0 ? shape.zw + (shape.y + 1.0) * square
                                 : corner % 2 == 0 ? two.xy : two.zw;
    disc = vec4(shape.yzw, other_side.w);
    number = float(part + 1) / 255.0;
    here = vec4(p, dot(one_side.xyz, vec3(p, 1.0)), dot(other_side.xyz, vec3(p, 1.0)));
    if (one_side.w > 0.0) place(p, shape.x);
    else leave_out();
}

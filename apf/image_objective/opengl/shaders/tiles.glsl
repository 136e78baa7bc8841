// Where a picture lies in the frame buffer: as one of many tiles, each of the size of the largest
// region of interest. An instance draws a tile; tiles are pictures (V, N) from number `first` on.
layout(std430, binding = 0) readonly buffer Regions { ivec4 regions[]; };  // (V,), ends excluded
uniform int first, n_particles, columns;
uniform ivec2 tile, atlas;
out float gl_ClipDistance[4];

// Place a vertex of the picture at pixel p; nothing is drawn outside of the region.
void place(vec2 p, float depth)
{
    const vec4 region = vec4(regions[(first + gl_InstanceID) / n_particles]) - 0.5;
    const vec2 corner = vec2(tile * ivec2(gl_InstanceID % columns, gl_InstanceID / columns));
    gl_ClipDistance[0] = p.x - region.x;
    gl_ClipDistance[1] = p.y - region.y;
    gl_ClipDistance[2] = region.z - p.x;
    gl_ClipDistance[3] = region.w - p.y;
    gl_Position = vec4(2.0 * (corner + p - region.xy) / vec2(atlas) - 1.0, 2.0 * depth - 1.0, 1.0);
}
// Place a vertex of a primitive that is not to be seen: all of its vertices at one place.
void leave_out() { place(vec2(-9.0), 0.0); }

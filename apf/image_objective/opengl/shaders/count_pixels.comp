// Counts the pixels of the tiles that were drawn; counterpart of cl/kernels/image/counting.h. A
// work-group per tile takes GROUP_X x GROUP_Y pixels at a time.
layout(local_size_x = GROUP_X, local_size_y = GROUP_Y) in;
layout(binding = 0) uniform sampler2D drawn;                               // part / 255, edge
layout(binding = 1) uniform usampler2DArray maps;                          // silhouette, proximity
layout(std430, binding = 0) readonly buffer Regions { ivec4 regions[]; };  // (V,), ends excluded
layout(std430, binding = 1) writeonly buffer Counts { int counts[]; };     // (V, N, N_COUNTS)
const int N_COUNTS = 4;
uniform int first, n_particles, columns;
uniform ivec2 tile;
shared int totals[N_COUNTS];

void main()
{
    const int id = int(gl_WorkGroupID.x), view = (first + id) / n_particles;
    const int lane = int(gl_LocalInvocationIndex);
    const ivec2 corner = tile * ivec2(id % columns, id / columns);
    const ivec4 region = regions[view];
    const ivec2 size = region.zw - region.xy;
    int mine[N_COUNTS];
    for (int i = 0; i < N_COUNTS; ++i) mine[i] = 0;
    for (int i = lane; i < N_COUNTS; i += GROUP_X * GROUP_Y) totals[i] = 0;
    barrier();
    for (int y = int(gl_LocalInvocationID.y); y < size.y; y += GROUP_Y)
        for (int x = int(gl_LocalInvocationID.x); x < size.x; x += GROUP_X) {
            const vec2 pixel = texelFetch(drawn, corner + ivec2(x, y), 0).xy;
            if (pixel == vec2(0.0)) continue;
            const uvec2 seen = texelFetch(maps, ivec3(region.xy + ivec2(x, y), view), 0).xy;
            if (pixel.y > 0.0) {
                mine[0] += 1;
                mine[1] += int(seen.y);
            }
            if (pixel.x == 0.0) continue;
            mine[2] += 1;
            mine[3] += int(seen.x > 127u);
        }
    for (int i = 0; i < N_COUNTS; ++i) atomicAdd(totals[i], mine[i]);
    barrier();
    for (int i = lane; i < N_COUNTS; i += GROUP_X * GROUP_Y)
        counts[(first + id) * N_COUNTS + i] = totals[i];
}

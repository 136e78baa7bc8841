// All posed cones as parts of all pictures: the flat model of Rymut 2016, 4.3, or the same with the
// round ends that the cones have in cones.h. Twin: reference/image_objective/render.py. Defines:
// N_PARTS, and ROUND_ENDS, 0 or 1.
#if !defined(CAMERA_FLOATS) || !defined(CONE_FLOATS) || !defined(FAR_OUT) || !defined(N_PARTS) || \
    !defined(ROUND_ENDS)
#error "image/parts.cl needs CAMERA_FLOATS, CONE_FLOATS, FAR_OUT, N_PARTS and ROUND_ENDS"
#endif
#include "common/camera.h"
#include "common/cones.h"
#include "image/parts.h"

// Lines flatter than this, px from end to end, are tilted so much.
#define FLAT 1e-4f

static inline Side side_between(float2 p, float2 q, float turn)
{
    const float2 along = q - p;
    const float rise = fabs(along.y) >= FLAT ? along.y : along.y < 0.0f ? -FLAT : FLAT;
    Side side = {p.x, p.y, along.x / rise, turn * rise < 0.0f};
    return side;
}

static inline float cross2(float2 a, float2 b) { return a.x * b.y - a.y * b.x; }

// parts: (V, N, N_PARTS) of cones (N, N_PARTS, CONE_FLOATS). edged: (N_PARTS,), whether it has
// edges, and which of its ends are free (bits 0 and 1).
__kernel void place_parts(int n_particles, __global const float *cones,
                          __global const float *cameras, __global const int2 *edged,
                          __global Part *parts)
{
    const int id = get_global_id(0), view = get_global_id(1);
    if (id >= n_particles * N_PARTS) return;
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    __global const float *cone = cones + (size_t)id * CONE_FLOATS;
    const float3 eye = vload3(0, camera + 25);
    float3 corners[4];
    cone_corners(vload16(0, cone), eye, corners);
    float2 pixels[4];
    bool seen = true;
    for (int i = 0; i < 4; ++i) {
        seen &= camera_project(camera, corners[i].x, corners[i].y, corners[i].z, &pixels[i]) > 0;
        seen &= fabs(pixels[i].x) < FAR_OUT && fabs(pixels[i].y) < FAR_OUT;
    }
    const float turn = cross2(pixels[2] - pixels[0], pixels[3] - pixels[1]);
    Part part;
    for (int i = 0; i < 4; ++i) part.sides[i] = side_between(pixels[i], pixels[(i + 1) % 4], turn);

    const float first = 0.5f * distance(pixels[0], pixels[1]);
    const float second = 0.5f * distance(pixels[2], pixels[3]);
    const float widest = fmax(first, second);
    const float2 a = 0.5f * (pixels[0] + pixels[1]), b = 0.5f * (pixels[2] + pixels[3]);
    // Seen along its axis a cone shows an end rather than its side.
    part.bare = distance(a, b) < widest;
    part.ends[0] = ROUND_ENDS ? a : 0.5f * (a + b);
    part.ends[1] = ROUND_ENDS ? b : part.ends[0];
    part.radii[0] = ROUND_ENDS ? first : part.bare ? widest : 0.0f;
    part.radii[1] = ROUND_ENDS ? second : part.radii[0];
    part.number = id % N_PARTS;
    part.edged = edged[part.number].x;
    part.outlined = part.bare ? 3 : ROUND_ENDS ? edged[part.number].y : 0;
    float top = fmin(fmin(pixels[0].y, pixels[1].y), fmin(pixels[2].y, pixels[3].y));
    float bottom = fmax(fmax(pixels[0].y, pixels[1].y), fmax(pixels[2].y, pixels[3].y));
    for (int e = 0; e < 2; ++e) {
        if (part.radii[e] == 0.0f) continue;
        top = fmin(top, part.ends[e].y - part.radii[e]);
        bottom = fmax(bottom, part.ends[e].y + part.radii[e]);
    }
    part.top = seen ? (int)ceil(top) : 1;
    part.bottom = seen ? (int)floor(bottom) : 0;
    part.distance = distance(eye, 0.5f * (vload3(0, cone) + vload3(0, cone + 4)));
    parts[(size_t)view * n_particles * N_PARTS + id] = part;
}

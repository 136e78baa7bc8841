// Posed cones of a pack of particles in local memory; CONE_FLOATS numbers each as cones.h has them.
// Twin: apf/body/cones.py. Defines: those of kinematics.h.
#if !defined(FAR_OUT) || !defined(SPAN_FLOATS)
#error "common/packed_cones.h needs FAR_OUT and SPAN_FLOATS"
#endif
#include "common/camera.h"
#include "common/kinematics.h"

// What distances need beside the cone, SPAN_FLOATS numbers: (axis, -axis . A) / axis . axis, whose
// product with a point says how far along it is; axis . axis; growth of the radius; -X . A; -Y . A.
INLINED void cone_span(__local const vfloat *cone, __local vfloat *span)
{
    const vpoint a = load_point(cone), b = load_point(cone + 4);
    const vpoint axis = {b.x - a.x, b.y - a.y, b.z - a.z};
    const vfloat length2 = inner(axis, axis);
    span[0] = axis.x / length2;
    span[1] = axis.y / length2;
    span[2] = axis.z / length2;
    span[3] = -inner(axis, a) / length2;
    span[4] = length2;
    span[5] = cone[7] - cone[3];
    span[6] = -inner(load_point(cone + 8), a);
    span[7] = -inner(load_point(cone + 12), a);
}

// The cones of the particles from `first` on in the world, and their spans.
INLINED void take_cones(__global const float *table, __global const float *poses, int first,
                        int n_particles, __local float *body, __local vfloat *turns,
                        __local vfloat *frames, __local vfloat *cones, __local vfloat *spans)
{
    take_body(table, body);
    take_pose(poses, first, n_particles, body, turns);
    pose_bones(turns, body, frames, 0);
    place_cones(body, frames, cones);
    for (int c = get_local_id(0); c < N_CONES; c += GROUP)
        cone_span(cones + c * CONE_FLOATS, spans + c * SPAN_FLOATS);
    barrier(CLK_LOCAL_MEM_FENCE);
}

// Signed distance from `point` to the cone's surface, negative inside; the ends are rounded.
INLINED vfloat packed_distance(__local const vfloat *cone, __local const vfloat *span,
                               vpoint point)
{
    const vfloat along = inner_plus(load_point(span), point, span[3]);
    const vfloat t = within(along, 0.0f, 1.0f), beyond = along - t;
    const vfloat u = inner_plus(load_point(cone + 8), point, span[6]);
    const vfloat v = inner_plus(load_point(cone + 12), point, span[7]);
    return sqrt(u * u + v * v + beyond * beyond * span[4]) - (cone[3] + t * span[5]);
}

// Pixels of the corners A + s, A - s, B - s, B + s of the trapezoid that the cone shows to the
// camera (Kwolek & Rymut 2016, section 3): x and y of each; NOWHERE if one of them has no image.
#define NOWHERE -1e6f

INLINED void cone_outline(__local const vfloat *cone, __global const float *camera,
                          __local vfloat *corners)
{
    const vpoint a = load_point(cone), b = load_point(cone + 4);
    const vpoint x = load_point(cone + 8), y = load_point(cone + 12);
    const vpoint to_eye = {camera[25] - a.x, camera[26] - a.y, camera[27] - a.z};
    vfloat ex = inner(to_eye, x), ey = inner(to_eye, y);
    const vfloat norm = sqrt(ex * ex + ey * ey);
    // With the axis pointing at the eye the side is any normal.
    ex = norm > 1e-9f ? ex / norm : 0.0f;
    ey = norm > 1e-9f ? ey / norm : 1.0f;
    ey = -ey / inner(x, x);
    ex = ex / inner(y, y);
    const vpoint side = {ey * x.x + ex * y.x, ey * x.y + ex * y.y, ey * x.z + ex * y.z};
    vfloat px[4], py[4];
    vint seen = -1;
    for (int i = 0; i < 4; ++i) {
        const vpoint end = i < 2 ? a : b;
        const vfloat radius = (i == 0 || i == 3 ? 1.0f : -1.0f) * cone[i < 2 ? 3 : 7];
        const vfloat depth =
            camera_project_pack(camera, end.x + radius * side.x, end.y + radius * side.y,
                                end.z + radius * side.z, &px[i], &py[i]);
        seen &= (depth > 0.0f) & (px[i] > -FAR_OUT) & (px[i] < FAR_OUT) & (py[i] > -FAR_OUT) &
                (py[i] < FAR_OUT);
    }
    for (int i = 0; i < 4; ++i) {
        corners[2 * i] = seen ? px[i] : NOWHERE;
        corners[2 * i + 1] = seen ? py[i] : NOWHERE;
    }
}

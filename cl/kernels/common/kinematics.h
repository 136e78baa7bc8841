// Forward kinematics (Rymut 2016 eq. 4.18-4.21) of a pack of poses by a work-group; twin:
// body/kinematics.py. Defines: GROUP, N_DOF, N_BONES, N_LEVELS, N_CONES and that of pack.h.
//
// The table of a body, BODY_FLOATS numbers: per bone its parent, first axis, number of axes, level
// in the tree (0 for roots), rest rotation (row-major) and offset; per axis its kind (0-5 = tx ty
// tz rx ry rz), sign, dof, its bone's parent (-1 of roots); per cone CONE_FLOATS in its bone's frame, element CONE_BONE
// holding the bone.
#if !defined(AXIS_FLOATS) || !defined(BONE_FLOATS) || !defined(CONE_BONE) || \
    !defined(CONE_FLOATS) || !defined(FRAME_FLOATS) || !defined(GROUP) || !defined(N_BONES) || \
    !defined(N_CONES) || !defined(N_DOF) || !defined(N_LEVELS)
#error "common/kinematics.h needs AXIS_FLOATS, BONE_FLOATS, CONE_BONE, CONE_FLOATS, FRAME_FLOATS, GROUP, N_BONES, N_CONES, N_DOF and N_LEVELS"
#endif
#include "common/pack.h"

#define BODY_AXES (N_BONES * BONE_FLOATS)
#define BODY_CONES (BODY_AXES + N_DOF * AXIS_FLOATS)
#define BODY_FLOATS (BODY_CONES + N_CONES * CONE_FLOATS)

// Copies the body's table to local memory, all of it at once: what follows reads it in many small
// steps of which each waits for the one before.
INLINED void take_body(__global const float *table, __local float *body)
{
    for (int i = get_local_id(0); i < BODY_FLOATS; i += GROUP) body[i] = table[i];
    barrier(CLK_LOCAL_MEM_FENCE);
}

// Signed value of every axis, or sine and cosine of its angle: turns, N_DOF x 2. The poses are
// those of particles first, first + 1, ...; beyond the last the last is taken again.
INLINED void take_pose(__global const float *poses, int first, int n_particles,
                       __local const float *body, __local vfloat *turns)
{
    for (int a = get_local_id(0); a < N_DOF; a += GROUP) {
        __local const float *axis = body + BODY_AXES + a * AXIS_FLOATS;
        const int dof = (int)axis[2];
#define VALUE(l) poses[lane_index(first, 0x##l, n_particles) * N_DOF + dof]
        const vfloat value = axis[1] * PACK_OF(vfloat, VALUE);
#undef VALUE
        turns[2 * a] = axis[0] < 3.0f ? value : sin(value);
        turns[2 * a + 1] = cos(value);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
}

// One row of a rotation, and the origin's coordinate beside it.
typedef struct { vfloat x, y, z, origin; } frame_row;

// The row after an axis of the kind along or about k = 0, 1, 2: a slide by turn[0], or a turn with
// that sine and the cosine turn[1], which mixes the two other columns.
INLINED frame_row moved(frame_row row, bool slides, int k, __local const vfloat *turn)
{
    const vfloat s = turn[0], c = turn[1];
    const vfloat u = k == 0 ? row.y : k == 1 ? row.z : row.x;
    const vfloat v = k == 0 ? row.z : k == 1 ? row.x : row.y;
    if (slides) {
        row.origin += s * (k == 0 ? row.x : k == 1 ? row.y : row.z);
        return row;
    }
    const vfloat mixed_u = c * u + s * v, mixed_v = c * v - s * u;
    if (k == 0) return (frame_row){row.x, mixed_u, mixed_v, row.origin};
    if (k == 1) return (frame_row){mixed_v, row.y, mixed_u, row.origin};
    return (frame_row){mixed_u, mixed_v, row.z, row.origin};
}

// Frames of all bones in their parents', N_BONES x FRAME_FLOATS: three rows of the rotation, each
// with the origin's coordinate behind it. One item per row: axes keep rows apart. hinges: see
// pose_bones; here they are in the parents' frames.
INLINED void turn_bones(__local const vfloat *turns, __local const float *body,
                        __local vfloat *frames, __local vfloat *hinges)
{
    for (int item = get_local_id(0); item < 3 * N_BONES; item += GROUP) {
        const int b = item / 3, i = item % 3;
        __local const float *bone = body + b * BONE_FLOATS, *rest = bone + 4;
        const vfloat zero = 0.0f;
        frame_row row = {zero + rest[3 * i], zero + rest[3 * i + 1], zero + rest[3 * i + 2],
                         zero + rest[9 + i]};
        const int first = (int)bone[1], end = first + (int)bone[2];
        for (int a = first; a < end; ++a) {
            __local const float *axis = body + BODY_AXES + a * AXIS_FLOATS;
            const int kind = (int)axis[0], k = kind % 3;
            if (hinges) {
                __local vfloat *hinge = hinges + 6 * (int)axis[2];
                hinge[i] = axis[1] * (k == 0 ? row.x : k == 1 ? row.y : row.z);
                hinge[3 + i] = row.origin;
            }
            row = moved(row, kind < 3, k, turns + 2 * a);
        }
        __local vfloat *out = frames + b * FRAME_FLOATS + 4 * i;
        out[0] = row.x;
        out[1] = row.y;
        out[2] = row.z;
        out[3] = row.origin;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
}

// Turns the `step`-th numbers of a column, in a bone's frame, into the world's; a place, not a
// direction, has the origin added.
INLINED void to_world(__local const vfloat *frame, bool place, int step,
                      __local vfloat *column)
{
    const vfloat x = column[0], y = column[step], z = column[2 * step];
    for (int i = 0; i < 3; ++i) {
        __local const vfloat *row = frame + 4 * i;
        const vfloat turned = row[0] * x + row[1] * y + row[2] * z;
        column[i * step] = place ? turned + row[3] : turned;
    }
}

// Frames of all bones in the world, as turn_bones has them: W = W_parent L, level by level. One item
// per column, which needs no other of its bone.
// Where `hinges` is not null it gets, per degree of freedom, the axis in the world (with its sign)
// and a point on it, 6 numbers.
INLINED void pose_bones(__local const vfloat *turns, __local const float *body,
                        __local vfloat *frames, __local vfloat *hinges)
{
    turn_bones(turns, body, frames, hinges);
    for (int level = 1; level < N_LEVELS; ++level) {
        for (int item = get_local_id(0); item < 4 * N_BONES; item += GROUP) {
            __local const float *bone = body + item / 4 * BONE_FLOATS;
            if ((int)bone[3] == level)
                to_world(frames + (int)bone[0] * FRAME_FLOATS, item % 4 == 3, 4,
                         frames + item / 4 * FRAME_FLOATS + item % 4);
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    for (int item = get_local_id(0); item < (hinges ? 2 * N_DOF : 0); item += GROUP) {
        __local const float *axis = body + BODY_AXES + item / 2 * AXIS_FLOATS;
        if (axis[3] >= 0.0f)
            to_world(frames + (int)axis[3] * FRAME_FLOATS, item % 2 == 1, 1,
                     hinges + 6 * (int)axis[2] + item % 2 * 3);
    }
    if (hinges) barrier(CLK_LOCAL_MEM_FENCE);
}

// The cones in the world, N_CONES x CONE_FLOATS as cones.h has them, from what pose_bones gave.
INLINED void place_cones(__local const float *body, __local const vfloat *frames,
                         __local vfloat *posed)
{
    for (int item = get_local_id(0); item < 4 * N_CONES; item += GROUP) {
        const int n = item / 4, part = item % 4;  // end centres and section axes
        __local const float *cone = body + BODY_CONES + n * CONE_FLOATS;
        __local const vfloat *frame = frames + (int)cone[CONE_BONE] * FRAME_FLOATS;
        __local vfloat *out = posed + n * CONE_FLOATS + 4 * part;
        const float x = cone[4 * part], y = cone[4 * part + 1], z = cone[4 * part + 2];
        for (int i = 0; i < 3; ++i) {
            __local const vfloat *row = frame + 4 * i;
            out[i] = row[0] * x + row[1] * y + row[2] * z;
            if (part < 2) out[i] += row[3];
        }
        out[3] = part < 2 ? cone[4 * part + 3] : 0.0f;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
}

// Writes the posed cones of the particles from `first` on, N_CONES x CONE_FLOATS each.
INLINED void store_cones(__local const vfloat *cones, int first, int n_particles,
                         __global float *posed)
{
    for (int i = get_local_id(0); i < N_CONES * CONE_FLOATS; i += GROUP) {
        float lanes[PACK];
        STORE_PACK(cones[i], lanes);
        for (int l = 0; l < min(PACK, n_particles - first); ++l)
            posed[(first + l) * N_CONES * CONE_FLOATS + i] = lanes[l];
    }
}

// Forward kinematics (Rymut 2016 eq. 4.18-4.21) of a pack of poses by a work-group; twin:
// reference/kinematics.py. Defines: GROUP, N_DOF, N_BONES, N_LEVELS, N_CONES and that of pack.h.
//
// The tables of a body: bones, N_BONES x int4 (parent, first axis, number of axes, level in the
// tree, 0 for roots); bone_fixed, N_BONES x 12 (rest rotation row-major, offset); axes, N_DOF x
// int4 (kind 0-5 = tx ty tz rx ry rz, sign, dof, 0); cones, N_CONES x CONE_FLOATS in their bone's
// frame, element 11 holding the bone.
#include "pack.h"

#ifndef CONE_FLOATS
#define CONE_FLOATS 16
#endif
#define FRAME_FLOATS 12

// Signed value of every axis, or sine and cosine of its angle: turns, N_DOF x 2. The poses are
// those of particles first, first + 1, ...; beyond the last the last is taken again.
inline void take_pose(__global const float *poses, int first, int n_particles,
                      __global const int4 *axes, __local vfloat *turns)
{
    for (int a = get_local_id(0); a < N_DOF; a += GROUP) {
        const int4 axis = axes[a];
#define VALUE(l) poses[lane_index(first, 0x##l, n_particles) * N_DOF + axis.z]
        const vfloat value = (float)axis.y * PACK_OF(vfloat, VALUE);
#undef VALUE
        turns[2 * a] = axis.x < 3 ? value : sin(value);
        turns[2 * a + 1] = cos(value);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
}

// Frames of all bones in the world, N_BONES x FRAME_FLOATS: three rows of the rotation, each with
// the origin's coordinate behind it. One item per row, since W = W_parent L keeps rows apart.
// Where `hinges` is not null it gets, per degree of freedom, the axis in the world (with its sign)
// and a point on it, 6 numbers.
inline void pose_bones(__local const vfloat *turns, __global const int4 *bones,
                       __global const float *bone_fixed, __global const int4 *axes,
                       __local vfloat *frames, __local vfloat *hinges)
{
    for (int level = 0; level < N_LEVELS; ++level) {
        for (int item = get_local_id(0); item < 3 * N_BONES; item += GROUP) {
            const int b = item / 3, i = item % 3;
            const int4 bone = bones[b];
            if (bone.w != level) continue;
            __global const float *fixed = bone_fixed + 12 * b;
            __local vfloat *row = frames + b * FRAME_FLOATS + 4 * i;
            if (level == 0) {
                for (int j = 0; j < 3; ++j) row[j] = fixed[3 * i + j];
                row[3] = fixed[9 + i];
            } else {
                __local const vfloat *p = frames + bone.x * FRAME_FLOATS + 4 * i;
                for (int j = 0; j < 3; ++j)
                    row[j] = p[0] * fixed[j] + p[1] * fixed[3 + j] + p[2] * fixed[6 + j];
                row[3] = p[3] + p[0] * fixed[9] + p[1] * fixed[10] + p[2] * fixed[11];
            }
            for (int a = bone.y; a < bone.y + bone.z; ++a) {
                const int4 axis = axes[a];
                if (hinges) {
                    hinges[6 * axis.z + i] = (float)axis.y * row[axis.x % 3];
                    hinges[6 * axis.z + 3 + i] = row[3];
                }
                if (axis.x < 3) {
                    row[3] += row[axis.x] * turns[2 * a];
                } else {
                    // A rotation about axis k mixes the two other columns.
                    const int k = (axis.x - 3 + 1) % 3, l = (axis.x - 3 + 2) % 3;
                    const vfloat s = turns[2 * a], c = turns[2 * a + 1];
                    const vfloat u = row[k], v = row[l];
                    row[k] = c * u + s * v;
                    row[l] = c * v - s * u;
                }
            }
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
}

// The cones in the world, N_CONES x CONE_FLOATS as cones.h has them, from what pose_bones gave.
inline void place_cones(__global const float *cones, __local const vfloat *frames,
                        __local vfloat *posed)
{
    for (int item = get_local_id(0); item < 4 * N_CONES; item += GROUP) {
        const int n = item / 4, part = item % 4;  // end centres and section axes
        __global const float *cone = cones + n * CONE_FLOATS;
        __local const vfloat *frame = frames + (int)cone[11] * FRAME_FLOATS;
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

// Forward kinematics (Rymut 2016 eq. 4.18-4.21); twin: reference/kinematics.py.
// Defines: N_DOF, N_BONES, N_CONES.
//
// The tables of a body: bones, N_BONES x int4 (parent, first axis, number of axes, 0); bone_fixed,
// N_BONES x 12 (rest rotation row-major, offset); axes, int4 (kind 0-5 = tx ty tz rx ry rz, sign,
// dof, 0); cones, N_CONES x CONE_FLOATS in their bone's frame, element 11 holding the bone.
#include "cones.h"

// World rotations and origins of all bones in `pose`. Where `hinges` is not null it gets, per
// degree of freedom, 6 floats: the axis in the world (with its sign) and a point on it.
inline void pose_bones(__global const float *pose, __global const int4 *bones,
                       __global const float *bone_fixed, __global const int4 *axes,
                       float rotations[N_BONES][9], float origins[N_BONES][3],
                       __global float *hinges)
{
    for (int b = 0; b < N_BONES; ++b) {
        const int4 bone = bones[b];
        __global const float *fixed = bone_fixed + 12 * b;
        float r[9], o[3];
        for (int i = 0; i < 3; ++i) {
            if (bone.x < 0) {
                for (int j = 0; j < 3; ++j) r[3 * i + j] = fixed[3 * i + j];
                o[i] = fixed[9 + i];
            } else {
                const float *p = rotations[bone.x] + 3 * i;
                for (int j = 0; j < 3; ++j)
                    r[3 * i + j] = p[0] * fixed[j] + p[1] * fixed[3 + j] + p[2] * fixed[6 + j];
                o[i] = origins[bone.x][i] + p[0] * fixed[9] + p[1] * fixed[10] + p[2] * fixed[11];
            }
        }
        for (int a = bone.y; a < bone.y + bone.z; ++a) {
            const int kind = axes[a].x;
            const float value = axes[a].y * pose[axes[a].z];
            if (hinges) {
                __global float *hinge = hinges + 6 * axes[a].z;
                for (int i = 0; i < 3; ++i) {
                    hinge[i] = axes[a].y * r[3 * i + kind % 3];
                    hinge[3 + i] = o[i];
                }
            }
            if (kind < 3) {
                for (int i = 0; i < 3; ++i) o[i] += r[3 * i + kind] * value;
            } else {
                // A rotation about axis k mixes the two other columns of r.
                const int k = (kind - 3 + 1) % 3, l = (kind - 3 + 2) % 3;
                float c;
                const float s = sincos(value, &c);
                for (int i = 0; i < 3; ++i) {
                    const float u = r[3 * i + k], v = r[3 * i + l];
                    r[3 * i + k] = c * u + s * v;
                    r[3 * i + l] = c * v - s * u;
                }
            }
        }
        for (int i = 0; i < 9; ++i) rotations[b][i] = r[i];
        for (int i = 0; i < 3; ++i) origins[b][i] = o[i];
    }
}

// The cones in the world, from what pose_bones gave.
inline void place_cones(__global const float *cones, float rotations[N_BONES][9],
                        float origins[N_BONES][3], __global float *posed)
{
    for (int n = 0; n < N_CONES; ++n) {
        __global const float *cone = cones + n * CONE_FLOATS;
        __global float *out = posed + n * CONE_FLOATS;
        const int b = (int)cone[11];
        for (int i = 0; i < 3; ++i) {
            const float *r = rotations[b] + 3 * i;
            out[i] = origins[b][i] + r[0] * cone[0] + r[1] * cone[1] + r[2] * cone[2];
            out[4 + i] = origins[b][i] + r[0] * cone[4] + r[1] * cone[5] + r[2] * cone[6];
            out[8 + i] = r[0] * cone[8] + r[1] * cone[9] + r[2] * cone[10];
            out[12 + i] = r[0] * cone[12] + r[1] * cone[13] + r[2] * cone[14];
        }
        out[3] = cone[3];
        out[7] = cone[7];
        out[11] = out[15] = 0.0f;
    }
}

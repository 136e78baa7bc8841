// Forward kinematics of all particles; twin: reference/kinematics.py. The tables and the defines
// are explained in kinematics.h.
#include "kinematics.h"

__kernel void pose_cones(int n_particles, __global const float *poses,
                         __global const int4 *bones, __global const float *bone_fixed,
                         __global const int4 *axes, __global const float *cones,
                         __global float *posed)
{
    const int particle = get_global_id(0);
    if (particle >= n_particles) return;
    float rotations[N_BONES][9], origins[N_BONES][3];
    pose_bones(poses + particle * N_DOF, bones, bone_fixed, axes, rotations, origins, 0);
    place_cones(cones, rotations, origins, posed + particle * N_CONES * CONE_FLOATS);
}

// Forward kinematics of all particles, one work-group per pack; twin: body/kinematics.py. The
// tables and the defines are explained in kinematics.h.
#if !defined(PACK)
#error "tracking/kinematics.cl needs PACK"
#endif
#include "common/kinematics.h"

__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void pose_cones(int n_particles, __global const float *poses,
                __global const float *table, __global float *posed)
{
    __local vfloat turns[2 * N_DOF], frames[N_BONES * FRAME_FLOATS];
    __local vfloat cones[N_CONES * CONE_FLOATS];
    __local float body[BODY_FLOATS];
    const int first = get_group_id(0) * PACK;
    take_body(table, body);
    take_pose(poses, first, n_particles, body, turns);
    pose_bones(turns, body, frames, 0);
    place_cones(body, frames, cones);
    store_cones(cones, first, n_particles, posed);
}

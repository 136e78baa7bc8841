// How far points of the body lie from where cameras saw them; twin:
// reference/likelihood/keypoints.py. Defines: those of kinematics.h; CAMERA_FLOATS.
#if !defined(CAMERA_FLOATS) || !defined(PACK)
#error "tracking/keypoints.cl needs CAMERA_FLOATS and PACK"
#endif
#include "common/kinematics.h"
#include "common/observed.h"
#include "common/posture.h"
#include "common/reduction.h"

// Sums up what the observations of a frame miss, each at most 1, and adds to the errors `weight`
// times the sum over the most there could be, or over their number where `per_seen` (1 without any); or puts
// it there, where not `adds`. exchange: what it costs that a point is taken for its partner.
// posture: see posture.h; its error is added with a weight of its own. One work-group per pack of
// particles.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void score_points(int n_particles, int adds, int per_seen, float weight, float reach,
                  float exchange, float posture_weight, __global const float4 *posture,
                  __global const float *poses, __global const float *table,
                  __global const float *cameras, __global const float4 *observed,
                  __global float *errors)
{
    __local vfloat turns[2 * N_DOF], frames[N_BONES * FRAME_FLOATS], sums[GROUP];
    __local float body[BODY_FLOATS];
    const int lane = get_local_id(0), first = get_group_id(0) * PACK;
    const int n = observed_count(observed);
    take_body(table, body);
    take_pose(poses, first, n_particles, body, turns);
    pose_bones(turns, body, frames, 0);
    vfloat sum = missed_by_all(lane, reach, exchange, cameras, observed, frames);
    const float most_seen = per_seen ? (float)n : observed_most(observed);
    sum = n > 0 ? sum * (weight / most_seen) : (vfloat)(per_seen && lane == 0 ? weight : 0.0f);
    if (posture_weight > 0.0f)
        sum += posture_weight *
               posture_error(lane, posture, poses, first, n_particles, body, frames);
    sum = group_sum_of_packs(sums, sum);
    if (lane == 0) {
        float lanes[PACK];
        STORE_PACK(sum, lanes);
        for (int l = 0; l < PACK && first + l < n_particles; ++l)
            errors[first + l] = adds ? errors[first + l] + lanes[l] : lanes[l];
    }
}

// The posture prior of a pack of poses; twin: reference/likelihood/voxel.py, posture_errors.
#if !defined(BONE_FLOATS) || !defined(FRAME_FLOATS) || !defined(GROUP) || !defined(N_DOF)
#error "common/posture.h needs BONE_FLOATS, FRAME_FLOATS, GROUP and N_DOF"
#endif
#include "common/pack.h"

// The share of its rise that a prior's mean has where the bone `child` is lifted relative to its
// parent's parent: the fourth power of (1 - c) / 2, c the cosine between their z axes. It is 0 for an
// arm that hangs down, 1/16 for a horizontal one, 1 for one that points up. frames: in the world.
INLINED vfloat risen(int child, __local const float *body, __local const vfloat *frames)
{
    const int parent = (int)body[child * BONE_FLOATS];
    __local const vfloat *z = frames + child * FRAME_FLOATS + 2;
    __local const vfloat *up = frames + (int)body[parent * BONE_FLOATS] * FRAME_FLOATS + 2;
    const vfloat lift = 0.5f - 0.5f * (z[0] * up[0] + z[4] * up[4] + z[8] * up[8]);
    return lift * lift * lift * lift;
}

// Sum over the degrees of freedom from `lane` on in steps of GROUP of the squared distance from the
// prior's mean in its sigmas. posture: per degree of freedom rest, 1 / sigma (0 where all values are
// as likely), and by how much the mean rises from rest while which bone is lifted.
INLINED vfloat posture_error(int lane, __global const float4 *posture, __global const float *poses,
                             int first, int n_particles, __local const float *body,
                             __local const vfloat *frames)
{
    vfloat sum = 0.0f;
    for (int dof = lane; dof < N_DOF; dof += GROUP) {
        const float4 prior = posture[dof];
#define VALUE(l) poses[lane_index(first, 0x##l, n_particles) * N_DOF + dof]
        vfloat bent = PACK_OF(vfloat, VALUE) - prior.x;
#undef VALUE
        if (prior.z != 0.0f) bent -= prior.z * risen((int)prior.w, body, frames);
        bent *= prior.y;
        sum += bent * bent;
    }
    return sum;
}

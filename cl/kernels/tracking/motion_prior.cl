// How far poses are from what is expected after the last frame; twin:
// reference/likelihood/motion_prior.py. Define: N_DOF. motion: N_DOF x (last estimate, expected
// next), NaN before there is an estimate.
#if !defined(N_DOF)
#error "tracking/motion_prior.cl needs N_DOF"
#endif

// Adds to the errors `weight` times the squared length of the change, scaled. An item per particle.
__kernel void add_motion_errors(int n, float weight, __global const float *factors,
                                __global const float2 *motion, __global const float *poses,
                                __global float *errors)
{
    const int particle = get_global_id(0);
    if (particle >= n || isnan(motion[0].y)) return;
    float sum = 0.0f;
    for (int dof = 0; dof < N_DOF; ++dof) {
        const float change = factors[dof] * (poses[particle * N_DOF + dof] - motion[dof].y);
        sum += change * change;
    }
    errors[particle] += weight * sum;
}

// Ends a frame with this pose: the next one is expected `velocity` times the change further on.
__kernel void expect_motion(float velocity, __global const float *pose, __global float2 *motion)
{
    const int dof = get_global_id(0);
    if (dof >= N_DOF) return;
    const float last = motion[dof].x;
    const float change = isnan(last) ? 0.0f : pose[dof] - last;
    motion[dof] = (float2)(pose[dof], pose[dof] + velocity * change);
}

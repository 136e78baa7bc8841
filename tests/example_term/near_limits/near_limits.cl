// How near poses are to the limits of the joints; twin: example_term/near_limits/term.py. Define:
// N_DOF. ranges: N_DOF x (middle of the limits, 1 / half of their distance; 0 for none).
#if !defined(N_DOF)
#error "near_limits.cl needs N_DOF"
#endif

// Adds to the errors `weight` times the mean square of what lies beyond the share `free` of the way
// from the middle to a limit. An item per particle.
__kernel void add_limit_errors(int n, float weight, float free, __global const float2 *ranges,
                               __global const float *poses, __global float *errors)
{
    const int particle = get_global_id(0);
    if (particle >= n) return;
    float sum = 0.0f;
    for (int dof = 0; dof < N_DOF; ++dof) {
        const float away = fabs(poses[particle * N_DOF + dof] - ranges[dof].x) * ranges[dof].y;
        const float beyond = fmax(away - free, 0.0f) / (1.0f - free);
        sum += beyond * beyond;
    }
    errors[particle] += weight * sum / N_DOF;
}

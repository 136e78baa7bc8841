// Observation model of the particle filter; twin: reference/filters/annealed.py.

// Rymut 2016 eq. (2.42): (1 - f)^2, whose exponent 1 / sigma_z^2 the annealing finds or is given.
__kernel void squared_errors(int n, __global const float *errors, __global float *squared)
{
    const int particle = get_global_id(0);
    if (particle >= n) return;
    squared[particle] = errors[particle] * errors[particle];
}

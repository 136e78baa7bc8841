// Particle swarm, synchronous, one global best (Rymut 2016 eq. 2.27-2.31); twin:
// reference/filters/swarm.py. Define: GROUP, N_DOF.
#if !defined(GROUP) || !defined(N_DOF)
#error "tracking/swarm.cl needs GROUP and N_DOF"
#endif
#include "common/philox.h"

// Eq. (2.27)-(2.28): velocities and positions of one iteration, from 1 on; the first starts from
// rest. A particle that leaves the limits stops there. result: the global best (N_DOF), ...
__kernel void move(int n, int iteration, float inertia, float cognitive, float social,
                   __global const uint2 *seed, __global const uint *frame,
                   __global const float2 *limits, __global const float *result,
                   __global const float *bests, __global float *velocities,
                   __global float *poses)
{
    const int dof = get_global_id(0), particle = get_global_id(1);
    if (dof >= N_DOF || particle >= n) return;
    const int at = particle * N_DOF + dof;
    const uint4 words = philox4x32((uint4)(frame[0], iteration, particle, dof), seed[0]);
    const float pose = poses[at];
    float velocity = iteration > 1 ? inertia * velocities[at] : 0.0f;
    velocity += cognitive * uniform01(words.x) * (bests[at] - pose) +
                social * uniform01(words.y) * (result[dof] - pose);
    const float2 limit = limits[dof];
    const float moved = pose + velocity, kept = clamp(moved, limit.x, limit.y);
    poses[at] = kept;
    velocities[at] = moved == kept ? velocity : 0.0f;
}

// Eq. (2.29)-(2.30): every particle's own best and the best of all, which the next frame starts
// from: it becomes the parent of all particles. The last iteration of a frame counts it. One
// work-group.
// result: the global best (N_DOF), the deviation of the particles' bests from it (N_DOF), then per
// iteration the number of particles that improved, 0 and the least error.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void update_bests(int n, int iteration, int last, __global uint *frame,
                  __global const float *errors, __global const float *poses,
                  __global float *bests, __global float *best_errors, __global int *parents,
                  __global float *result)
{
    __local float least[GROUP];
    __local int which[GROUP], improved[GROUP];
    const int lane = get_local_id(0);
    least[lane] = INFINITY;
    which[lane] = n - 1;
    improved[lane] = 0;
    for (int i = lane; i < n; i += GROUP) {
        if (iteration == 0 || errors[i] < best_errors[i]) {
            best_errors[i] = errors[i];
            for (int dof = 0; dof < N_DOF; ++dof)
                bests[i * N_DOF + dof] = poses[i * N_DOF + dof];
            ++improved[lane];
        }
        if (best_errors[i] < least[lane]) {
            least[lane] = best_errors[i];
            which[lane] = i;
        }
    }
    barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
    for (int half_size = GROUP / 2; half_size > 0; half_size /= 2) {
        if (lane < half_size) {
            const int other = lane + half_size;
            const bool nearer = least[other] < least[lane] ||
                                (least[other] == least[lane] && which[other] < which[lane]);
            if (nearer) {
                least[lane] = least[other];
                which[lane] = which[other];
            }
            improved[lane] += improved[other];
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    const int best = which[0];
    for (int i = lane; i < n; i += GROUP) parents[i] = best;
    for (int dof = lane; dof < N_DOF; dof += GROUP) {
        const float pose = bests[best * N_DOF + dof];
        float squares = 0.0f;
        for (int i = 0; i < (last ? n : 0); ++i) {
            const float offset = bests[i * N_DOF + dof] - pose;
            squares += offset * offset;
        }
        result[dof] = pose;
        result[N_DOF + dof] = sqrt(squares / n);
    }
    if (lane == 0) {
        if (last) ++frame[0];
        __global float *diagnostics = result + 2 * N_DOF + 3 * iteration;
        diagnostics[0] = improved[0];
        diagnostics[1] = 0.0f;
        diagnostics[2] = least[0];
    }
}

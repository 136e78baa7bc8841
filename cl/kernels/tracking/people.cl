// Where several people are expected. Twin: apf/reference/likelihood/voxel.py. Defines: PEOPLE, N_CONES of a
// body, CONE_FLOATS, STEP of a person's cones in a frame, ALONG spheres on a cone.
#if !defined(ALONG) || !defined(CONE_FLOATS) || !defined(N_CONES) || !defined(PEOPLE) || \
    !defined(STEP)
#error "tracking/people.cl needs ALONG, CONE_FLOATS, N_CONES, PEOPLE and STEP"
#endif

// Spheres (PEOPLE, N_CONES, ALONG) along the cones: those of the frame in slot `newest`, moved
// `ahead` times as they moved since the frame in slot `before`.
__kernel void expect_spheres(int newest, int before, float ahead,
                             __global const float *restrict cones, __global float4 *restrict spheres)
{
    const int id = get_global_id(0);
    if (id >= PEOPLE * N_CONES * ALONG) return;
    const int person = id / (N_CONES * ALONG), cone = id / ALONG % N_CONES;
    const float share = id % ALONG / (ALONG - 1.0f);
    __global const float *now = cones + (newest * PEOPLE + person) * STEP + cone * CONE_FLOATS;
    __global const float *then = cones + (before * PEOPLE + person) * STEP + cone * CONE_FLOATS;
    const float4 here = vload4(0, now) + share * (vload4(1, now) - vload4(0, now));
    const float4 there = vload4(0, then) + share * (vload4(1, then) - vload4(0, then));
    spheres[id] = here + ahead * (here - there);
}

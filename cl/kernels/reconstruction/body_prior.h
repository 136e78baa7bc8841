// A tracked body as a prior of the voxels' occupancy; twin: body_evidence in
// psfs/reference/reconstructor.py. `body`: a row of 16 floats with the counts inside, the counts
// outside, the depth, m, from which a voxel is inside, the distance from which it is outside, the
// number of cones, and what body_location.cl reads; then the cones (see cones.h) with, in [11], the
// most that a distance to them changes per metre.
#include "common/cones.h"

// Counts that the body adds to a voxel at `point`; the most that it adds within `radius` of there.
static inline int body_counts(__global const float *body, float3 point, float radius)
{
    const int n = (int)body[4];
    float nearest = INFINITY;
    for (int i = 1; i <= n; ++i) {
        const float16 cone = vload16(i, body);
        nearest = fmin(nearest, cone_distance(cone, point) - radius * cone.sb);
    }
    const float within = clamp((body[3] - nearest) / (body[3] + body[2]), 0.0f, 1.0f);
    return (int)rint(body[1] + within * (body[0] - body[1]));
}

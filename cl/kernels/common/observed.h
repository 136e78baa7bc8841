// Points of the body as cameras see them in a frame, a table of float4: first (their number, the
// most there could be, 0, 0), then for each (bone, x, y, z) the point on its bone, (bone, x, y, z)
// the point that it may be taken for instead, bone -1 without, and (x, y, 1 / scale, camera) the
// undistorted pixel, the deviation's inverse and the number of the camera.
#if !defined(CAMERA_FLOATS) || !defined(FRAME_FLOATS) || !defined(GROUP)
#error "common/observed.h needs CAMERA_FLOATS, FRAME_FLOATS and GROUP"
#endif
#include "common/pack.h"

typedef struct { float4 own, other, seen; } observation;

static inline int observed_count(__global const float4 *observed) { return (int)observed[0].x; }

static inline float observed_most(__global const float4 *observed) { return observed[0].y; }

static inline observation observed_at(__global const float4 *observed, int k)
{
    __global const float4 *row = observed + 1 + 3 * k;
    return (observation){row[0], row[1], row[2]};
}

// The share d^2 / (d^2 + reach^2) of the distance, in deviations, of the point `on` (bone, x, y, z)
// from where a camera saw it; 1 behind the camera. No camera.h: pixels have no distortion any more.
INLINED vfloat missed(float4 on, float4 seen, float reach, __global const float *cameras,
                      __local const vfloat *frames)
{
    __global const float *camera = cameras + (int)seen.w * CAMERA_FLOATS;
    __local const vfloat *frame = frames + (int)on.x * FRAME_FLOATS;
    const vfloat x = frame[0] * on.y + (frame[1] * on.z + (frame[2] * on.w + frame[3]));
    const vfloat y = frame[4] * on.y + (frame[5] * on.z + (frame[6] * on.w + frame[7]));
    const vfloat z = frame[8] * on.y + (frame[9] * on.z + (frame[10] * on.w + frame[11]));
    const vfloat depth = camera[6] * x + camera[7] * y + camera[8] * z + camera[11];
    const vfloat inverse = 1.0f / depth, scale = seen.z / reach;
    const vfloat u = inverse * (camera[0] * x + camera[1] * y + camera[2] * z + camera[9]);
    const vfloat v = inverse * (camera[3] * x + camera[4] * y + camera[5] * z + camera[10]);
    const vfloat off_x = scale * (camera[12] * u + camera[16] * v + camera[14] - seen.x);
    const vfloat off_y = scale * (camera[13] * v + camera[15] - seen.y);
    const vfloat square = off_x * off_x + off_y * off_y;
    return depth > 1e-6f ? square / (1.0f + square) : (vfloat)1.0f;
}

// Sum of what the observations of a frame miss, each at most 1, of every GROUP-th from number `lane`
// on. exchange: what it costs that a point is taken for its partner.
INLINED vfloat missed_by_all(int lane, float reach, float exchange,
                             __global const float *cameras, __global const float4 *observed,
                             __local const vfloat *frames)
{
    const int n = observed_count(observed);
    vfloat sum = 0.0f;
    for (int k = lane; k < n; k += GROUP) {
        const observation one = observed_at(observed, k);
        vfloat share = missed(one.own, one.seen, reach, cameras, frames);
        if (one.other.x >= 0.0f) {
            const vfloat as_other = missed(one.other, one.seen, reach, cameras, frames);
            share = least(share, exchange + (1.0f - exchange) * as_other);
        }
        sum += share;
    }
    return sum;
}

// Points of the body as cameras see them in a frame, a table of float4: first (their number, the
// most there could be, 0, 0), then for each (bone, x, y, z) the point on its bone, (bone, x, y, z)
// the point that it may be taken for instead, bone -1 without, and (x, y, 1 / scale, camera) the
// undistorted pixel, the deviation's inverse and the number of the camera.

typedef struct { float4 own, other, seen; } observation;

inline int observed_count(__global const float4 *observed) { return (int)observed[0].x; }

inline float observed_most(__global const float4 *observed) { return observed[0].y; }

inline observation observed_at(__global const float4 *observed, int k)
{
    __global const float4 *row = observed + 1 + 3 * k;
    return (observation){row[0], row[1], row[2]};
}

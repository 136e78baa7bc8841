// What a camera can say about a whole box of voxels, from the extremes of its evidence in tiles of
// pixels. Defines: FINE and COARSE, the edges of tiles, px; UNKNOWN, see hidden.cl; HIDDEN, what such
// evidence adds.
// Counterpart: psfs/voxels/bricks.py.
#if !defined(COARSE) || !defined(FINE) || !defined(HIDDEN) || !defined(UNKNOWN)
#error "reconstruction/bricks.h needs COARSE, FINE, HIDDEN and UNKNOWN"
#endif
#include "common/camera.h"
#include "common/sizes.h"

// Two levels of tiles; of either one every view's tiles are row-major.
#define ALONG (COARSE / FINE)
#define FINE_X ((WIDTH + FINE - 1) / FINE)
#define FINE_Y ((HEIGHT + FINE - 1) / FINE)
#define COARSE_X ((WIDTH + COARSE - 1) / COARSE)
#define COARSE_Y ((HEIGHT + COARSE - 1) / COARSE)
#define VIEW_TILES (FINE_X * FINE_Y + COARSE_X * COARSE_Y)
// Rectangles wider or higher than this, px, are looked up in the coarse tiles.
#define FINE_REACH 64
// Floats per camera of `reach`: 0-3 largest |d px/du|, |d px/dv|, |d py/du|, |d py/dv| for
// normalised coordinates (u, v) within radius [5]; 4 largest radius of a pixel of the picture;
// 5 a larger radius; 6 largest radius that has an image at all.
// Slack for float rounding, px.
#define SLACK 1.0f

// What a pixel's evidence adds to a voxel.
static inline int known_counts(int counts) { return counts == UNKNOWN ? HIDDEN : counts; }

// The evidence that a camera adds to any point of a box lies between low and high; seen: 0 by
// none of its points, 1 by some, 2 by all.
typedef struct { int low, high, seen; } EvidenceRange;

static inline EvidenceRange range_of(int low, int high, int seen)
{
    EvidenceRange range;
    range.low = low;
    range.high = high;
    range.seen = seen;
    return range;
}

// Half the extent along camera axis `row` - s * (optical axis) of a box with half edges h.
static inline float support(__global const float *row, __global const float *optical, float s,
                            float3 h)
{
    return fabs(row[0] - s * optical[0]) * h.x + fabs(row[1] - s * optical[1]) * h.y +
           fabs(row[2] - s * optical[2]) * h.z;
}

// A box projects into a rectangle around its centre's pixel: the perspective division is bounded
// exactly per image axis, the lens by the largest derivatives of its distortion.
static inline EvidenceRange evidence_range(int2 picture, __global const float *camera,
                                           __global const float *reach,
                                           __global const char2 *tiles, float3 centre, float3 h)
{
    const EvidenceRange none = range_of(0, 0, 0), unknown = range_of(-127, 127, 1);
    const float cz = camera[6] * centre.x + camera[7] * centre.y + camera[8] * centre.z +
                     camera[11];
    const float deep = support(camera + 6, camera + 6, 0.0f, h);
    if (cz + deep < 0.0f) return none;
    if (cz - deep < 1e-3f) return unknown;
    const float cx = camera[0] * centre.x + camera[1] * centre.y + camera[2] * centre.z +
                     camera[9];
    const float cy = camera[3] * centre.x + camera[4] * centre.y + camera[5] * centre.z +
                     camera[10];
    const float u = cx / cz, v = cy / cz;
    const float hu = support(camera, camera + 6, u, h) / (cz - deep);
    const float hv = support(camera + 3, camera + 6, v, h) / (cz - deep);
    const float radius = sqrt(u * u + v * v), extent = sqrt(hu * hu + hv * hv);
    if (radius - extent > reach[4] * 1.001f) return none;
    float2 pixel;
    if (radius > reach[5]) return unknown;
    if (camera_project(camera, centre.x, centre.y, centre.z, &pixel) <= 0.0f) return unknown;

    const float wx = reach[0] * hu + reach[1] * hv + SLACK;
    const float wy = reach[2] * hu + reach[3] * hv + SLACK;
    const float x0 = floor(pixel.x - wx + 0.5f), x1 = floor(pixel.x + wx + 0.5f);
    const float y0 = floor(pixel.y - wy + 0.5f), y1 = floor(pixel.y + wy + 0.5f);
    const float last_x = camera[23] - 1.0f, last_y = camera[24] - 1.0f;
    if (x1 < 0.0f || y1 < 0.0f || x0 > last_x || y0 > last_y) return none;
    const int all_seen = x0 >= 0.0f && y0 >= 0.0f && x1 <= last_x && y1 <= last_y &&
                         radius + extent < reach[5] && radius + extent < reach[6] * 0.999f;

    const int coarse = x1 - x0 > FINE_REACH || y1 - y0 > FINE_REACH;
    const int edge = coarse ? COARSE : FINE, columns = coarse ? COARSE_X : FINE_X;
    if (coarse) tiles += FINE_X * FINE_Y;
    const int first_x = (int)(x0 > 0.0f ? x0 : 0.0f) / edge;
    const int first_y = (int)(y0 > 0.0f ? y0 : 0.0f) / edge;
    const int end_x = (int)(x1 < last_x ? x1 : last_x) / edge;
    const int end_y = (int)(y1 < last_y ? y1 : last_y) / edge;
    int low = all_seen ? 127 : 0, high = all_seen ? -127 : 0;
    for (int y = first_y; y <= end_y; ++y)
        for (int x = first_x; x <= end_x; ++x) {
            const char2 tile = tiles[y * columns + x];
            low = tile.x < low ? tile.x : low;
            high = tile.y > high ? tile.y : high;
        }
    return range_of(low, high, all_seen ? 2 : 1);
}

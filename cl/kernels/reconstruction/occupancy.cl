// Voxel occupancy, Song et al. eq. (3)-(9), brick by brick; twin: psfs/reference/surface.py.
// Defines: CAMERA_ROOM, most cameras; FACES (see smoothing.h), those of bricks.h; BX BY BZ
// voxels of a brick, CX CY CZ bricks of a coarse one; LANES items per work-group, LANES_Z of them
// along z; NO_DISTORTION if no camera has any; BODY: whether a tracked body is a
// prior (see body_prior.h). The number of cameras is an argument, for GPUs N_CAMERAS as well, see
// sizes.h.
//
// A CPU runs a work-group of one item, whose inner loops along z become vector code (branches are
// selections for this reason). A camera whose evidence is the same all over a brick (mostly the
// background's) is added once instead of being looked up for every voxel: that changes nothing
// but the time.
#if !defined(BODY) || !defined(BX) || !defined(BY) || !defined(BZ) || !defined(CAMERA_FLOATS) || \
    !defined(CAMERA_ROOM) || !defined(CX) || !defined(CY) || !defined(CZ) || \
    !defined(FIND_LANES) || !defined(LANES) || !defined(LANES_Z) || \
    !defined(REACH_FLOATS)
#error "reconstruction/occupancy.cl needs BODY, BX, BY, BZ, CAMERA_FLOATS, CAMERA_ROOM, CX, CY, CZ, FIND_LANES, LANES, LANES_Z and REACH_FLOATS"
#endif
#include "common/lanes.h"
#include "reconstruction/body_prior.h"
#include "reconstruction/bricks.h"
#include "reconstruction/smoothing.h"

#ifndef N_CAMERAS
#define N_CAMERAS n_cameras
#endif
#if BZ != 16
#error "occupancy.cl: a brick's row along z is a word of 16 bits"
#endif
// Voxels of a brick, with those around it, which the smoothing needs.
#define DX (BX + 2)
#define DY (BY + 2)
#define DZ (BZ + 2)
#define ROWS (DX * DY)
#define BRICK_VOXELS (BX * BY * BZ)
// A voxel's sum of evidence counts and, above it, the number of pictures that it is in.
#define SEEN 65536
#define FOR_ROWS(row, n) for (int row = lane / LANES_Z; row < (n); row += LANES / LANES_Z)
#define FOR_Z(z, n) for (int z = lane % LANES_Z; z < (n); z += LANES_Z)

// World coordinate of the centre of padded voxel i along an axis (the padding shifts by one).
static inline float centre_of(__global const float *geometry, int axis, float i)
{
    return geometry[axis] + (i - 0.5f) * geometry[3];
}

// One byte of the maps. A CPU loads the word that it is in: its vector units gather words alone.
static inline int evidence_at(__global const char *evidence, int place)
{
#if LANES > 1
    return evidence[place];
#else
    return ((__global const int *)evidence)[place >> 2] << (24 - 8 * (place & 3)) >> 24;
#endif
}

// Evidence of all cameras for the voxels of a brick whose first padded voxel is (x0, y0, z0).
static inline void sum_evidence(int2 picture, int n_cameras, __global const float *restrict cameras,
                                __global const float *restrict reach,
                                __global const char2 *restrict tiles,
                                __global const char *restrict evidence,
                                __global const float *restrict geometry, int x0, int y0, int z0,
                                SCRATCH int *sums, SCRATCH int *fixed, SCRATCH int *open)
{
    const int lane = get_local_id(0);
    const float3 centre = (float3)(centre_of(geometry, 0, x0 + 0.5f * (DX - 1)),
                                   centre_of(geometry, 1, y0 + 0.5f * (DY - 1)),
                                   centre_of(geometry, 2, z0 + 0.5f * (DZ - 1)));
    const float3 h = 0.5f * geometry[3] * (float3)(DX - 1, DY - 1, DZ - 1);
    for (int k = lane; k < N_CAMERAS; k += LANES) {
        const EvidenceRange range = evidence_range(picture, cameras + k * CAMERA_FLOATS,
                                                   reach + k * REACH_FLOATS,
                                                   tiles + k * VIEW_TILES, centre, h);
        open[k] = range.seen == 1 || range.low != range.high;
        fixed[k] = open[k] || range.seen == 0 ? 0 : range.low + SEEN;
    }
    SYNC;
    int base = 0;
    for (int k = 0; k < N_CAMERAS; ++k) base += fixed[k];
    FOR_ROWS(row, ROWS)
        FOR_Z(z, DZ) sums[row * DZ + z] = base;
    for (int k = 0; k < N_CAMERAS; ++k) {
        if (!open[k]) continue;
        __global const float *camera = cameras + k * CAMERA_FLOATS;
        const int first = k * (WIDTH * HEIGHT);
        FOR_ROWS(row, ROWS) {
            const float px = centre_of(geometry, 0, x0 + row / DY);
            const float py = centre_of(geometry, 1, y0 + row % DY);
            FOR_Z(z, DZ) {
                float2 pixel;
                camera_project(camera, px, py, centre_of(geometry, 2, z0 + z), &pixel);
                const int at = camera_offset(camera, pixel, WIDTH);
                const int counts = evidence_at(evidence, first + (at >= 0 ? at : 0));
                sums[row * DZ + z] += at >= 0 ? known_counts(counts) + SEEN : 0;
            }
        }
    }
}

#if BODY
// Adds the counts of the tracked body to the sums of a brick's voxels.
static inline void add_body(__global const float *restrict body,
                            __global const float *restrict geometry, int x0, int y0, int z0,
                            SCRATCH int *sums)
{
    const int lane = get_local_id(0);
    SYNC;
    FOR_ROWS(row, ROWS) {
        const float px = centre_of(geometry, 0, x0 + row / DY);
        const float py = centre_of(geometry, 1, y0 + row % DY);
        FOR_Z(z, DZ)
            sums[row * DZ + z] +=
                body_counts(body, (float3)(px, py, centre_of(geometry, 2, z0 + z)), 0.0f);
    }
}
#define ADD_BODY add_body(body, geometry, x0, y0, z0, sums)
#else
#define ADD_BODY
#endif

// Place of a sum of counts in the table; of cameras alone it is never outside.
static inline int place_of(int n_cameras, int counts)
{
#if BODY
    counts = clamp(counts, -127 * N_CAMERAS, 127 * N_CAMERAS);
#endif
    return counts + 127 * N_CAMERAS;
}

// P(V = 1) by a voxel's sum.
static inline float occupancy_of(int n_cameras, int min_cameras,
                                 __global const float *restrict table, int packed)
{
    const int seeing = (packed + SEEN / 2) / SEEN;
    const float seen = table[place_of(n_cameras, packed - seeing * SEEN)];
    return seeing >= min_cameras ? seen : 0.0f;
}

#define BRICKS_X ((NX + BX - 1) / BX)
#define BRICKS_Y ((NY + BY - 1) / BY)
#define BRICKS_Z ((NZ + BZ - 1) / BZ)

// Can a voxel of the box be occupied, or smoothed into being so? Padded voxel (x0, y0, z0) is its
// first, `n` its number of voxels along the axes.
static inline int may_hold(int2 picture, int n_cameras, int min_cameras, float threshold,
                           __global const float *cameras, __global const float *reach,
                           __global const char2 *tiles, __global const float *table,
                           __global const float *geometry, __global const float *body,
                           int3 first, int3 n)
{
    const float3 centre = (float3)(centre_of(geometry, 0, first.x + 0.5f * (n.x - 1)),
                                   centre_of(geometry, 1, first.y + 0.5f * (n.y - 1)),
                                   centre_of(geometry, 2, first.z + 0.5f * (n.z - 1)));
    const float3 h = 0.5f * geometry[3] * (float3)(n.x - 1, n.y - 1, n.z - 1);
    int high = 0, seeing = 0;
    for (int k = 0; k < N_CAMERAS; ++k) {
        const EvidenceRange range = evidence_range(picture, cameras + k * CAMERA_FLOATS,
                                                   reach + k * REACH_FLOATS,
                                                   tiles + k * VIEW_TILES, centre, h);
        high += range.high;
        seeing += range.seen > 0;
    }
#if BODY
    high += body_counts(body, centre, length(h));
#endif
    // A mean of rounded numbers may exceed their largest by a few roundings.
    return seeing >= min_cameras &&
           table[place_of(n_cameras, high)] > threshold * (1.0f - 1e-5f);
}

// Lists the bricks in or beside which a voxel can be occupied after smoothing: `slots` is their
// place in the list, or -1. Clears the `bits` of all. One work-group per coarse brick. What lies two
// voxels beyond the brick counts: so its neighbours' values are exact as well.
__kernel void find_bricks(int2 picture, int3 grid, int n_cameras, int min_cameras,
                          float threshold, __global const float *restrict cameras,
                          __global const float *restrict reach,
                          __global const char2 *restrict tiles,
                          __global const float *restrict table,
                          __global const float *restrict geometry,
                          __global const float *restrict body,
                          __global int *restrict slots, __global int *restrict bricks,
                          __global int *restrict n_active, __global ushort *restrict bits)
{
    const int3 corner = (int3)(get_group_id(2) * CX, get_group_id(1) * CY, get_group_id(0) * CZ);
    const int3 size = (int3)(BX, BY, BZ);
    const int whole = may_hold(picture, n_cameras, min_cameras, threshold, cameras, reach, tiles,
                               table, geometry, body, corner * size - 1,
                               (int3)(CX, CY, CZ) * size + 4);
    for (int child = get_local_id(0); child < CX * CY * CZ; child += FIND_LANES) {
        const int3 brick = corner + (int3)(child / (CY * CZ), child / CZ % CY, child % CZ);
        if (brick.x >= BRICKS_X || brick.y >= BRICKS_Y || brick.z >= BRICKS_Z) continue;
        const int at = (brick.x * BRICKS_Y + brick.y) * BRICKS_Z + brick.z;
        int slot = -1;
        if (whole && may_hold(picture, n_cameras, min_cameras, threshold, cameras, reach, tiles,
                              table, geometry, body, brick * size - 1, size + 4)) {
            slot = atomic_inc(n_active);
            bricks[slot] = at;
        }
        slots[at] = slot;
    }
    // The lowest coarse brick clears whole rows along z, and those beside each other at once.
    const int end_x = min((corner.x + CX) * BX, NX), end_y = min((corner.y + CY) * BY, NY);
    for (int x = corner.x * BX; x < (corner.z == 0 ? end_x : 0); ++x) {
        const int end = (x * NY + end_y) * BRICKS_Z;
        for (int word = (x * NY + corner.y * BY) * BRICKS_Z + get_local_id(0); word < end;
             word += FIND_LANES)
            bits[word] = 0;
    }
}

// Bricks that the pool has room for, all cameras, those that must see a voxel, and the smoothed
// probability above which it is occupied.
typedef struct {
    int capacity, n_cameras, min_cameras;
    float threshold;
} occupancy_numbers;

// Smoothed probability of the voxels of the listed bricks, and which of them are occupied: a bit
// each, ushort per brick and row along z. A few work-groups share the list. Bricks beyond capacity
// have no room for their probability.
__kernel void sparse_occupancy(// constants
                               int2 picture, int3 grid, occupancy_numbers numbers,
                               __global const float *restrict cameras,
                               __global const float *restrict reach,
                               __global const float *restrict table,
                               __global const float *restrict geometry,
                               __global const float *restrict body,
                               // in
                               __global const char2 *restrict tiles,
                               __global const char *restrict evidence,
                               __global const int *restrict bricks,
                               __global const int *restrict n_active,
                               // out
                               __global float *restrict pool, __global ushort *restrict bits)
{
    const int capacity = numbers.capacity, n_cameras = numbers.n_cameras;
    const int min_cameras = numbers.min_cameras;
    const float threshold = numbers.threshold;
    SCRATCH int sums[ROWS * DZ], fixed[CAMERA_ROOM], open[CAMERA_ROOM];
    SCRATCH float p[ROWS * DZ], smoothed[BRICK_VOXELS];
    const int lane = get_local_id(0), n = *n_active;
    for (int slot = get_group_id(0); slot < n; slot += get_num_groups(0)) {
        const int brick = bricks[slot];
        const int x0 = brick / (BRICKS_Y * BRICKS_Z) * BX;
        const int y0 = brick / BRICKS_Z % BRICKS_Y * BY, z0 = brick % BRICKS_Z * BZ;
        sum_evidence(picture, n_cameras, cameras, reach, tiles, evidence, geometry, x0, y0, z0,
                     sums, fixed, open);
        ADD_BODY;
        FOR_ROWS(row, ROWS)
            FOR_Z(z, DZ)
                p[row * DZ + z] =
                    occupancy_of(n_cameras, min_cameras, table, sums[row * DZ + z]);
        SYNC;
        FOR_ROWS(row, BX * BY) {
            SCRATCH const float *near = p + ((row / BY + 1) * DY + row % BY + 1) * DZ + 1;
            FOR_Z(z, BZ) smoothed[row * BZ + z] = SMOOTHED(near + z, DY * DZ, DZ);
        }
        SYNC;
        if (slot < capacity)
            for (int i = lane; i < BRICK_VOXELS; i += LANES)
                pool[slot * BRICK_VOXELS + i] = smoothed[i];
        for (int row = lane; row < BX * BY; row += LANES) {
            const int x = x0 + row / BY, y = y0 + row % BY;
            if (x >= NX || y >= NY) continue;
            uint mask = 0;
            for (int z = 0; z < BZ; ++z)
                mask |= (uint)(smoothed[row * BZ + z] > threshold) << z;
            if (NZ - z0 < BZ) mask &= (1u << (NZ - z0)) - 1u;
            bits[(x * NY + y) * BRICKS_Z + z0 / BZ] = (ushort)mask;
        }
        SYNC;
    }
}

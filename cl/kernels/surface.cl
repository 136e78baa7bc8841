// From occupancy to surface voxels: 3x3x3 smoothing, threshold, removal of the inside, stream
// compaction in ascending order. Defines: NX NY NZ of the grid (without padding), THRESHOLD.
#define EMPTY 0
#define INSIDE 1
#define SURFACE 2
#define ROWS (NX * NY)

// Mean over the 27 voxels around (x, y, z); `padded` has one more layer on every side.
__kernel void smooth(__global const float *restrict padded, __global float *restrict probability)
{
    const int z = get_global_id(0), y = get_global_id(1), x = get_global_id(2);
    if (z >= NZ || y >= NY || x >= NX) return;
    float sum = 0.0f;
#pragma unroll
    for (int dx = 0; dx < 3; ++dx)
#pragma unroll
        for (int dy = 0; dy < 3; ++dy) {
            const int at = ((x + dx) * (NY + 2) + y + dy) * (NZ + 2) + z;
            sum += padded[at] + padded[at + 1] + padded[at + 2];
        }
    probability[(x * NY + y) * NZ + z] = sum * (1.0f / 27.0f);
}

// EMPTY, INSIDE or SURFACE: occupied with an empty 6-neighbour, or on the border of the grid.
__kernel void classify(__global const float *restrict probability, __global uchar *restrict kind)
{
    const int z = get_global_id(0), y = get_global_id(1), x = get_global_id(2);
    if (z >= NZ || y >= NY || x >= NX) return;
    const int at = (x * NY + y) * NZ + z;
    const int border = (x == 0) | (x == NX - 1) | (y == 0) | (y == NY - 1) |
                       (z == 0) | (z == NZ - 1);
    // Border voxels read themselves instead of what lies outside; `border` decides about them.
#define NEAR(offset) probability[border ? at : at + (offset)]
    const float p = probability[at];
    const int enclosed = (NEAR(-1) > THRESHOLD) & (NEAR(1) > THRESHOLD) &
                         (NEAR(-NZ) > THRESHOLD) & (NEAR(NZ) > THRESHOLD) &
                         (NEAR(-NY * NZ) > THRESHOLD) & (NEAR(NY * NZ) > THRESHOLD);
    const int surface = border | !enclosed;
    kind[at] = p > THRESHOLD ? (surface ? SURFACE : INSIDE) : EMPTY;
}

// Per row along z: how many surface voxels, how many occupied ones.
__kernel void count_rows(__global const uchar *restrict kind, __global int *restrict surface,
                         __global int *restrict occupied)
{
    const int row = get_global_id(0);
    if (row >= ROWS) return;
    int n_surface = 0, n_occupied = 0;
    for (int z = 0; z < NZ; ++z) {
        const uchar k = kind[row * NZ + z];
        n_surface += k == SURFACE;
        n_occupied += k != EMPTY;
    }
    surface[row] = n_surface;
    occupied[row] = n_occupied;
}

// One work-group of SCAN items: `surface` becomes its exclusive prefix sum; totals are written.
__kernel void scan_rows(__global int *restrict surface, __global const int *restrict occupied,
                        __global int *restrict n_surface, __global int *restrict n_occupied,
                        __local int *sums, __local int *volumes)
{
    const int item = get_local_id(0);
    const int share = (ROWS + SCAN - 1) / SCAN;
    const int first = min(item * share, ROWS), end = min(first + share, ROWS);
    int sum = 0, volume = 0;
    for (int row = first; row < end; ++row) {
        sum += surface[row];
        volume += occupied[row];
    }
    sums[item] = sum;
    volumes[item] = volume;
    barrier(CLK_LOCAL_MEM_FENCE);
    int before = 0;
    for (int other = 0; other < item; ++other) before += sums[other];
    if (item == SCAN - 1) {
        int total = 0;
        for (int other = 0; other < SCAN; ++other) total += volumes[other];
        *n_surface = before + sum;
        *n_occupied = total;
    }
    for (int row = first; row < end; ++row) {
        const int here = surface[row];
        surface[row] = before;
        before += here;
    }
}

// Write the flat indices of the surface voxels, row by row, each row where its prefix sum says.
__kernel void scatter_rows(__global const uchar *restrict kind, __global const int *restrict start,
                           __global const int *restrict n_surface, __global int *restrict indices)
{
    const int row = get_global_id(0);
    if (row >= ROWS) return;
    int at = start[row];
    const int end = row + 1 < ROWS ? start[row + 1] : *n_surface;
    for (int voxel = row * NZ; at < end; ++voxel)
        if (kind[voxel] == SURFACE) indices[at++] = voxel;
}

// Probabilities of the surface voxels, in their order.
__kernel void gather(__global const float *restrict probability,
                     __global const int *restrict indices, __global const int *restrict n_surface,
                     __global float *restrict gathered)
{
    const int n = *n_surface;
    for (int i = get_global_id(0); i < n; i += get_global_size(0))
        gathered[i] = probability[indices[i]];
}

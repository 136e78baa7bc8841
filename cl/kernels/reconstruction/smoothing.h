// The smoothing of the occupancy. Defines: FACES, 1 for the mean over a voxel and
// its six neighbours, 0 for that over 3x3x3 voxels.
#ifndef FACES
#error "reconstruction/smoothing.h needs FACES"
#endif

// The smoothed value at the voxel that `p` points to; `x` and `y` are the steps along these axes. A
// macro, since `p` may point into any memory.
#define SMOOTH_ROW(p) ((p)[-1] + (p)[0] + (p)[1])
#define SMOOTH_SLAB(p, y) (SMOOTH_ROW((p) - (y)) + SMOOTH_ROW(p) + SMOOTH_ROW((p) + (y)))
#if FACES
#define SMOOTHED(p, x, y) \
    ((SMOOTH_ROW(p) + ((p)[-(y)] + (p)[y]) + ((p)[-(x)] + (p)[x])) * (1.0f / 7.0f))
#else
#define SMOOTHED(p, x, y) \
    ((SMOOTH_SLAB((p) - (x), y) + SMOOTH_SLAB(p, y) + SMOOTH_SLAB((p) + (x), y)) * (1.0f / 27.0f))
#endif

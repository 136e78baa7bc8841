// Sizes that differ from take to take. They are arguments, so that one program serves all takes: a
// kernel or helper that uses these names has the parameter `int2 picture`, width and height of the
// stack of pictures, or `int3 grid`, the voxels along x, y and z. On GPUs they are defines as well,
// see size_defines in cl/workgroups.py.
#ifndef WIDTH
#define WIDTH picture.x
#define HEIGHT picture.y
#endif
#define PIXELS (WIDTH * HEIGHT)
#ifndef NX
#define NX grid.x
#define NY grid.y
#define NZ grid.z
#endif

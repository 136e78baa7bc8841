// Sizes that differ from take to take. They are arguments, not defines, so that one program serves all
// takes: a kernel or helper that uses these names has the parameter `int2 picture`, width and height
// of the stack of pictures, or `int3 grid`, the voxels along x, y and z.
#define WIDTH picture.x
#define HEIGHT picture.y
#define PIXELS (WIDTH * HEIGHT)
#define NX grid.x
#define NY grid.y
#define NZ grid.z

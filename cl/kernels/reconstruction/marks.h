// Marks say whether the silhouettes of the voxels touch MARK x MARK pixels. They lie behind the
// stack of silhouettes, which has a row more before and behind. Views are dimension 1 of the
// kernels. Define: MARK, px.
#include "common/sizes.h"

#define MARKS_X ((WIDTH + MARK - 1) / MARK)
#define MARKS_Y ((HEIGHT + MARK - 1) / MARK)
#define MARKS_PLACE (((size_t)get_global_size(1) * HEIGHT + 2) * WIDTH)

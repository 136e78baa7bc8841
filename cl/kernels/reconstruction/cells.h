// Cells of CELL x CELL pixels of a picture, along x and y; counterpart:
// psfs/cameras/rig_geometry.py.
#ifndef CELL
#error "reconstruction/cells.h needs CELL"
#endif
#include "common/sizes.h"

#define CELLS_X ((WIDTH + CELL - 1) / CELL)
#define CELLS_Y ((HEIGHT + CELL - 1) / CELL)

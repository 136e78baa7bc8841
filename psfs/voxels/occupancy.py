"""Voxel occupancy (Song et al. eq. 3-9) on an OpenCL device, of all voxels of a grid."""

from __future__ import annotations

import numpy as np

from cl import Array
from psfs.voxels.bricks import Bricks, bricks_along, lanes_of


class Occupancy:
    """The evidence maps of bricks in, P(V = 1) of every voxel out.

    probability: (nx + 2, ny + 2, nz + 2) float32.
    One layer of voxels around the grid is evaluated as well, so that the smoothing knows what
    lies beyond the border: a part of a grid gives the same voxels as the whole. A voxel's
    posterior log-odds are logit(prior) + the evidence of the cameras whose picture contains its
    projection; below `min_cameras` of them it is empty.

    The grid is worked on in bricks. Where a camera's evidence does not vary over the pixels that
    a brick covers (found from least and greatest evidence in tiles of 8 x 8 and 32 x 32 px), it
    is added once to the whole brick. Elsewhere every voxel is projected, lens distortion
    included, not looked up: a table of pixels would take 4 bytes per voxel and camera.
    """

    def __init__(self, bricks: Bricks) -> None:
        device, (nx, ny, nz) = bricks.device, bricks.shape
        shape = (nx + 2, ny + 2, nz + 2)
        self._bricks = bricks
        self.probability = device.empty(shape, np.float32, f"a grid of {nx * ny * nz:,} voxels")
        lanes = lanes_of(device, 0)
        along, group = bricks_along(shape), int(lanes["LANES"])
        self._launch = device.launch(
            device.kernel("reconstruction/occupancy", "occupancy", **bricks.defines, **lanes),
            (along[2] * group, along[1], along[0]),
            (group, 1, 1),
            **bricks.inputs,
            evidence=bricks.evidence,
            probability=self.probability,
        )

    def __call__(self) -> Array:
        self._bricks()
        self._launch()
        return self.probability

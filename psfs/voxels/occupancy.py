"""Voxel occupancy (Song et al. eq. 3-9) on an OpenCL device, of all voxels of a grid."""

from __future__ import annotations

import numpy as np

from cl import Array
from psfs.voxels.bricks import Bricks, count_bricks, lane_defines


class Occupancy:
    """Computation of P(V = 1) of every voxel from the evidence maps.

    probability: (nx + 2, ny + 2, nz + 2) float32. One layer of voxels around the grid is evaluated
    as well, since the smoothing needs it: so a part of a grid gives the same voxels as the whole. A
    voxel's posterior log-odds are logit(prior) + the evidence of the cameras whose picture contains
    its projection; below `min_cameras` of them it is empty.

    The grid is processed in bricks. If a camera's evidence is constant over the pixels that a brick
    covers (by the least and greatest evidence in tiles of 8 x 8 and 32 x 32 px), it is added once
    to the whole brick. Otherwise every voxel is projected, including lens distortion. There is no
    table of pixels, which would take 4 bytes per voxel and camera.
    """

    def __init__(self, bricks: Bricks) -> None:
        device, (nx, ny, nz) = bricks.device, bricks.shape
        shape = (nx + 2, ny + 2, nz + 2)
        self._bricks = bricks
        self.probability = device.empty(shape, np.float32, f"a grid of {nx * ny * nz:,} voxels")
        lanes = lane_defines(device, 0)
        along, group = count_bricks(shape), int(lanes["LANES"])
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

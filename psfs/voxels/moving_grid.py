"""Mean position of the voxels, and a grid that follows them from frame to frame."""

from __future__ import annotations

import numpy as np

from cl import Array, Device
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.surface import SurfaceList

#: Greatest number of surface voxels that are averaged; it bounds the time, and the precision
#: suffices.
SAMPLES = 2048


class MeanPosition:
    """`position()`: mean position of the surface voxels of a grid of `shape`; their flat indices
    and number are on the device."""

    def __init__(
        self, device: Device, shape: tuple[int, int, int], indices: Array, count: Array
    ) -> None:
        self._mean: Array = device.zeros(4, np.float32, "the mean position")
        lanes = 128 if device.is_gpu else 1
        self._launch = device.launch(
            device.kernel(
                "reconstruction/surface",
                "mean_position",
                **{"LANES": lanes, "CLOSED": 0, "SAMPLES": SAMPLES},
            ),
            (lanes,),
            (lanes,),
            grid=shape,
            indices=indices,
            n_surface=count,
            mean=self._mean,
        )

    def __call__(self) -> np.ndarray | None:
        """Return the mean position (3,), in voxels from the grid's origin, of at most `SAMPLES`
        voxels spread over the surface; None if there are none. Waits for the device."""
        self._launch()
        mean = self._mean.get().astype(np.float64)
        return mean[:3] if mean[3] > 0 else None


class GridFollower:
    """Computation of the next frame's grid from the latest surface: along x and y its middle is at
    the mean of the surface voxels, to within a voxel.

    The grid moves by whole voxels only. So the voxels are the same as those of one large grid, as
    long as the person moves less than half a grid between frames. The grid does not move along z,
    nor after a frame without voxels.
    """

    def __init__(self, device: Device, grid: VoxelGrid, surface: SurfaceList) -> None:
        self._position = MeanPosition(device, grid.shape, surface.indices, surface.count)

    def __call__(self, grid: VoxelGrid) -> VoxelGrid:
        """Return the next frame's grid: `grid` itself if it need not move. Waits for the device."""
        position = self._position()
        if position is None:
            return grid
        offset = (position - np.array(grid.shape) / 2) * [1, 1, 0]
        steps = np.trunc(offset)
        if not steps.any():
            return grid
        return VoxelGrid(grid.origin + steps * grid.voxel_size, grid.voxel_size, grid.shape)

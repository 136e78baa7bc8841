"""Where the voxels are in the mean, and a grid that follows them from frame to frame."""

from __future__ import annotations

import numpy as np

from cl import Array, Device
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.surface import SurfaceList

#: Surface voxels that are averaged, at most: a bound on the time it takes, not on the precision.
SAMPLES = 2048


class MeanPosition:
    """`position()`: the mean position of the surface voxels of a grid of `shape`, whose flat
    indices and number are on the device."""

    def __init__(
        self, device: Device, shape: tuple[int, int, int], indices: Array, count: Array
    ) -> None:
        self._mean: Array = device.zeros(4, np.float32, "the mean position")
        lanes = 128 if device.is_gpu else 1
        _, ny, nz = shape
        defines = {"NX": 1, "NY": ny, "NZ": nz, "THRESHOLD": 0.0, "LANES": lanes}
        self._launch = device.launch(
            device.kernel(
                "reconstruction/surface", "mean_position", **defines, CAPACITY=1, SAMPLES=SAMPLES
            ),
            (lanes,),
            (lanes,),
            indices=indices,
            n_surface=count,
            mean=self._mean,
        )

    def __call__(self) -> np.ndarray | None:
        """Return it (3,) in voxels from the grid's origin, of at most `SAMPLES` spread over the
        surface; None where there are none (waits for the device)."""
        self._launch()
        mean = self._mean.get().astype(np.float64)
        return mean[:3] if mean[3] > 0 else None


class Follower:
    """The latest frame's surface in, the next frame's grid out: its middle lies above or below
    the mean of the surface voxels, along x and y, to within a voxel.

    The grid moves by whole voxels only, so the same voxels come out as of one large grid, as long
    as the person stays within half a grid of where he or she was. It does not move along z. A
    frame without voxels leaves it where it is.
    """

    def __init__(self, device: Device, grid: VoxelGrid, surface: SurfaceList) -> None:
        self._position = MeanPosition(device, grid.shape, surface.indices, surface.count)

    def __call__(self, grid: VoxelGrid) -> VoxelGrid:
        """Return the next frame's grid: `grid` itself if it may stay (waits for the device)."""
        position = self._position()
        if position is None:
            return grid
        offset = (position - np.array(grid.shape) / 2) * [1, 1, 0]
        steps = np.trunc(offset)
        if not steps.any():
            return grid
        return VoxelGrid(grid.origin + steps * grid.voxel_size, grid.voxel_size, grid.shape)

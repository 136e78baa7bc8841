"""Smoothing, threshold and surface voxels on an OpenCL device (Song et al. 2.2.2, last step)."""

from __future__ import annotations

import numpy as np
import pyopencl

from cl import Array, Device, Launch
from psfs.launching import row_group

#: Items of the one work-group that sums up the rows.
_SCAN = 256


class Surface:
    """Occupancy of the padded grid in, smoothed probability and surface voxels out.

    probability: (nx, ny, nz) float32, the mean over 3x3x3 voxels. surface: (capacity,) int32,
    flat indices of the voxels above the threshold that have a 6-neighbour below it or lie on the
    grid's border, ascending; the first `count[0]` entries are valid. occupied: (1,) int32, all
    voxels above the threshold. The order is the same on every device and in every run.
    """

    def __init__(
        self, device: Device, shape: tuple[int, int, int], padded: Array, threshold: float
    ) -> None:
        nx, ny, nz = shape
        size = nx * ny * nz
        self.probability = device.empty(shape, np.float32, f"a grid of {size:,} voxels")
        self.surface = device.empty(size, np.int32, f"the surface of {size:,} voxels")
        self.count = device.zeros(1, np.int32, "the number of surface voxels")
        self.occupied = device.zeros(1, np.int32, "the number of occupied voxels")
        self._gathered = device.empty(size, np.float32, f"the surface of {size:,} voxels")
        kind = device.empty(shape, np.uint8, f"a grid of {size:,} voxels")
        rows = device.empty(nx * ny, np.int32, "the rows of the grid")
        volumes = device.empty(nx * ny, np.int32, "the rows of the grid")
        defines = {"NX": nx, "NY": ny, "NZ": nz, "THRESHOLD": float(threshold), "SCAN": _SCAN}

        def launch(
            name: str, size: tuple[int, ...], local: tuple[int, ...], *args: object
        ) -> Launch:
            kernel = device.kernel("surface", name, **defines)
            return device.launch(kernel, size, local, *args)

        box, per_voxel = (nz, ny, nx), row_group(device, nz)
        per_row = (64,)
        scratch = [pyopencl.LocalMemory(4 * _SCAN)] * 2
        totals = (self.count, self.occupied)
        self._launches = [
            launch("smooth", box, per_voxel, padded, self.probability),
            launch("classify", box, per_voxel, self.probability, kind),
            launch("count_rows", (nx * ny,), per_row, kind, rows, volumes),
            launch("scan_rows", (_SCAN,), (_SCAN,), rows, volumes, *totals, *scratch),
            launch("scatter_rows", (nx * ny,), per_row, kind, rows, self.count, self.surface),
        ]
        self._gather = launch(
            "gather", (4096,), (64,), self.probability, self.surface, self.count, self._gathered
        )

    def __call__(self) -> None:
        for launch in self._launches:
            launch()

    def surface_probability(self, count: int) -> np.ndarray:
        """(count,) float32 probabilities of the surface voxels, downloaded."""
        self._gather()
        return self._gathered.get(count)

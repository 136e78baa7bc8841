"""Smoothing, threshold and surface voxels on an OpenCL device (Song et al. 2.2.2, last step)."""

from __future__ import annotations

import math

import numpy as np

from cl import Array, Device, InputError, Kernel, Launch
from cl.signature import Argument
from cl.workgroups import row_group, size_defines
from psfs.voxels.config import OccupancyConfig

#: Number of voxels for which there is always memory; in larger grids for one in sixteen of the
#: list, and one in eight of a sparse grid, if that is more.
ROOM = 2**24


class SurfaceList:
    """Computation of the list of surface voxels from the bits of occupied voxels.

    bits: (nx, ny, ceil(nz / 16)) uint16. indices: (capacity,) int32, flat indices of the occupied
    voxels that have an empty neighbour (one of 26 if `closed`, else of 6) or lie on the grid's
    border, ascending; the first `count[0]` entries are valid. occupied: (1,) int32, number of all
    occupied voxels. The order is the same on every device and in every run.
    """

    def __init__(
        self, device: Device, shape: tuple[int, int, int], bits: Array, closed: bool = False
    ) -> None:
        nx, ny, _ = shape
        size = math.prod(shape)
        self._device = device
        self._gather: Launch | None = None
        self._gathered: Array
        self.capacity = min(size, max(ROOM, size // 16))
        self.indices = device.empty(self.capacity, np.int32, f"the surface of {size:,} voxels")
        self.count = device.zeros(1, np.int32, "the number of surface voxels")
        self.occupied = device.zeros(1, np.int32, "the number of occupied voxels")
        self._found = device.zeros(1, np.int32, "the number of surface voxels")
        lanes = 128 if device.is_gpu else 1
        starts = device.empty(nx * ny, np.int32, "the rows of the grid")
        totals = device.empty((nx, 2), np.int32, "the slabs of the grid")
        rows = {"bits": bits, "starts": starts, "totals": totals}
        sizes: dict[str, Argument] = {"grid": shape}
        defines = {
            "LANES": lanes,
            "CLOSED": int(closed),
            "FACES": 1,  # of no use here; as by default, so that one program does
            **size_defines(device, grid=shape),
        }
        listed = {"n_surface": self.count, "n_occupied": self.occupied, "found": self._found}
        listed["indices"] = self.indices
        room: dict[str, Argument] = {"capacity": self.capacity}
        self._launches = [
            device.launch(
                device.kernel("reconstruction/surface", name, **defines),
                (nx * lanes,),
                (lanes,),
                **sizes,
                **rows,
                **written,
            )
            for name, written in (("count_slabs", {}), ("list_surface", room | listed))
        ]

    def __call__(self) -> None:
        for launch in self._launches:
            launch()

    def gather(self, count: int, kernel: Kernel, **source: Argument) -> np.ndarray:
        """Download the `count` float32 values that `kernel` gathers from its `source` at the
        surface voxels. Each call must pass the same kernel."""
        if self._gather is None or self._gathered.size < count:
            what = "the surface's probability"
            self._gathered = out = self._device.empty(max(1, 2 * count), np.float32, what)
            listed = {"indices": self.indices, "n_surface": self.count}
            self._gather = self._device.launch(kernel, (4096,), (64,), **source, **listed, out=out)
        self._gather()
        return self._gathered.get(count)

    def check_room(self) -> None:
        """Raise InputError if the surface has more voxels than the list has room for. Waits for the
        device."""
        found = int(self._found.get()[0])
        if found > self.capacity:
            raise InputError(
                f"the surface has {found:,} voxels; expected at most {self.capacity:,} "
                "(are the silhouettes full of noise?)"
            )


class Surface:
    """Computation of smoothed probability and surface voxels from the occupancy of the padded grid.

    probability: (nx, ny, nz) float32, smoothed. list: the surface of the voxels above the
    threshold.
    """

    def __init__(
        self,
        device: Device,
        shape: tuple[int, int, int],
        padded: Array,
        config: OccupancyConfig | None = None,
    ) -> None:
        config = config or OccupancyConfig()
        nx, ny, nz = shape
        size, words = nx * ny * nz, -(-nz // 16)
        self._device = device
        self.probability = device.empty(shape, np.float32, f"a grid of {size:,} voxels")
        bits = device.empty((nx, ny, words), np.uint16, f"a grid of {size:,} voxels")
        self.list = SurfaceList(device, shape, bits, config.closed_surface)
        closed, faces = int(config.closed_surface), int(config.smoothing == "faces")
        defines = {"LANES": 1, "CLOSED": closed, "FACES": faces}
        defines |= size_defines(device, grid=shape)
        row, word = row_group(device), (64,)
        smooth, threshold_, self._gather = (
            device.kernel("reconstruction/surface", name, **defines)
            for name in ("smooth", "threshold", "gather")
        )
        probability = {"probability": self.probability}
        self._launches = [
            device.launch(smooth, (nz, ny, nx), row, grid=shape, padded=padded, **probability),
            device.launch(
                threshold_,
                (nx * ny * words,),
                word,
                grid=shape,
                least=config.threshold,
                **probability,
                bits=bits,
            ),
        ]

    def __call__(self) -> None:
        for launch in self._launches:
            launch()
        self.list()

    def surface_probability(self, count: int) -> np.ndarray:
        """Download the probabilities (count,) float32 of the surface voxels."""
        return self.list.gather(count, self._gather, probability=self.probability)

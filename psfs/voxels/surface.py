"""The list of surface voxels on an OpenCL device (Song et al. 2.2.2, last step)."""

from __future__ import annotations

import math

import numpy as np

from cl import Array, Device, InputError
from cl.array import get_together
from cl.signature import Argument
from cl.workgroups import size_defines

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
        defines = {"LANES": lanes, "CLOSED": int(closed), **size_defines(device, grid=shape)}
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

    def read_counts(self, more: Array) -> tuple[int, int, int]:
        """Download the numbers of surface voxels and of occupied ones, and that of an array (1,).
        Raises InputError if the surface has more voxels than the list has room for."""
        counts = get_together([self.count, self.occupied, more, self._found])
        count, occupied, another, found = (int(of[0]) for of in counts)
        if found > self.capacity:
            raise InputError(
                f"the surface has {found:,} voxels; expected at most {self.capacity:,} "
                "(are the silhouettes full of noise?)"
            )
        return count, occupied, another

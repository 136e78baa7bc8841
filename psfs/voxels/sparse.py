"""From evidence to surface voxels, only in the bricks that can be occupied, coarse to fine."""

from __future__ import annotations

import logging
import math

import numpy as np

from cl import Array
from cl.workgroups import row_group
from psfs.voxels.bricks import BRICK, COARSE_BRICK, Bricks, bricks_along, lanes_of
from psfs.voxels.surface import SurfaceList

log = logging.getLogger(__name__)

#: Room for the probability of all bricks up to this number of voxels, beyond it for one in eight.
_ROOM = 2**24


class SparseSurface:
    """The evidence maps of bricks in, surface voxels out: occupancy (Song et al. eq. 3-9) and
    smoothing only where a voxel can be occupied.

    A brick of 8 x 8 x 16 voxels is left out when the greatest evidence that each camera can add
    to any voxel in it or within two voxels of it stays below the threshold in sum. The bound is
    conservative: the occupied voxels, and the probability of them and of their neighbours, are
    those of the dense mode to the last bit; elsewhere the probability counts as 0. Bricks are
    found in coarse ones of 32 x 32 x 32 voxels first, and listed on the device.

    list: the surface of the voxels above the threshold. n_active: (1,) int32 bricks worked on.
    Memory grows with the occupied space: 512^3 voxels take 90 MiB.
    """

    def __init__(self, bricks: Bricks) -> None:
        device, shape = bricks.device, bricks.shape
        self._bricks, self.n_active, self._warned = bricks, bricks.n_active, False
        along, size = bricks_along(shape), math.prod(shape)
        n_bricks, brick_voxels = math.prod(along), math.prod(BRICK)
        self.capacity = min(n_bricks, max(_ROOM, size // 8) // brick_voxels)
        what = f"a sparse grid of {size:,} voxels"
        self._bits = device.zeros((*shape[:2], along[2]), np.uint16, what)
        self.list = SurfaceList(device, shape, self._bits)
        self.slots = device.empty(along, np.int32, what)
        self._listed = device.empty(n_bricks, np.int32, what)
        self._pool = device.empty((self.capacity, brick_voxels), np.float32, what)
        lanes = lanes_of(device, 1)
        self._defines = {**bricks.defines, **lanes, "CAPACITY": self.capacity}
        find, group = int(self._defines["FIND_LANES"]), int(lanes["LANES"])
        coarse = [-(-n // c) for n, c in zip(along, COARSE_BRICK, strict=True)]
        inputs = bricks.inputs | {"bricks": self._listed, "n_active": self.n_active}
        self._find = device.launch(
            device.kernel("reconstruction/occupancy", "find_bricks", **self._defines),
            (coarse[2] * find, coarse[1], coarse[0]),
            (find, 1, 1),
            **inputs,
            slots=self.slots,
        )
        groups = min(n_bricks, 16 * device.info.compute_units if device.is_gpu else 64)
        self._launch = device.launch(
            device.kernel("reconstruction/occupancy", "sparse_occupancy", **self._defines),
            (groups * group,),
            (group,),
            **inputs,
            evidence=bricks.evidence,
            pool=self._pool,
            bits=self._bits,
        )

        self._gather = device.kernel("reconstruction/occupancy", "sparse_gather", **self._defines)

    def __call__(self) -> None:
        self._bits.fill(0)
        self._bricks()
        self._find()
        self._launch()
        self.list()

    def surface_probability(self, count: int) -> np.ndarray:
        """Return (count,) float32 probabilities of the surface voxels, downloaded: the threshold
        where there was no room for them, which is warned of."""
        self._warn_of_room()
        return self.list.gathered(count, self._gather, pool=self._pool, slots=self.slots)

    @property
    def probability(self) -> Array:
        """(nx, ny, nz) float32 smoothed probability of the latest frame, 0 where no brick was
        worked on or there was no room, which is warned of; a new array each time. Raises InputError
        if that does not fit the device."""
        self._warn_of_room()
        device, (nx, ny, nz) = self._bricks.device, self._bricks.shape
        probability = device.empty((nx, ny, nz), np.float32, "the whole grid's probability")
        device.launch(
            device.kernel("reconstruction/occupancy", "spread", **self._defines),
            (nz, ny, nx),
            row_group(device, nz),
            pool=self._pool,
            slots=self.slots,
            probability=probability,
        )()
        return probability

    def _warn_of_room(self) -> None:
        """Warn once if more bricks can be occupied than there is room for (waits)."""
        n = int(self.n_active.get()[0])
        if n > self.capacity and not self._warned:
            self._warned = True
            log.warning(
                "%s bricks of the sparse grid can be occupied; only %s have room for their "
                "probability: the silhouettes are full of noise",
                f"{n:,}",
                f"{self.capacity:,}",
            )

"""From evidence to surface voxels, only in the bricks that can be occupied, coarse to fine."""

from __future__ import annotations

import math

import numpy as np

from cl import Array, Device, UserError
from psfs.bricks import BRICK, COARSE_BRICK, Bricks, bricks_along, lanes_of
from psfs.camera import CameraRig
from psfs.config import OccupancyConfig
from psfs.grid import VoxelGrid
from psfs.launching import row_group
from psfs.surface import SurfaceList

#: Room for the probability of all bricks up to this number of voxels, beyond it for one in eight.
_ROOM = 2**24


class SparseSurface:
    """Evidence maps in, surface voxels out: occupancy (Song et al. eq. 3-9) and smoothing only
    where a voxel can be occupied.

    A brick of 8 x 8 x 16 voxels is left out when the greatest evidence that each camera can add
    to any voxel in it or within two voxels of it stays below the threshold in sum. The bound is
    conservative: the occupied voxels, and the probability of them and of their neighbours, are
    those of the dense mode to the last bit; elsewhere the probability counts as 0. Bricks are
    found in coarse ones of 32 x 32 x 32 voxels first, and listed on the device.

    list: the surface of the voxels above the threshold. n_active: (1,) int32 bricks worked on.
    Memory grows with the occupied space: 512^3 voxels take 90 MiB.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        grid: VoxelGrid,
        evidence: Array,
        step: float,
        config: OccupancyConfig | None = None,
    ) -> None:
        config = config or OccupancyConfig()
        self._device, self._shape = device, grid.shape
        self._common = Bricks(device, rig, grid, evidence, step, config)
        self.n_active = self._common.n_active
        along = bricks_along(grid.shape)
        n_bricks, brick_voxels = math.prod(along), math.prod(BRICK)
        self.capacity = min(n_bricks, max(_ROOM, grid.size // 8) // brick_voxels)
        what = f"a sparse grid of {grid.size:,} voxels"
        self.bits = device.zeros((*grid.shape[:2], along[2]), np.uint16, what)
        self.list = SurfaceList(device, grid.shape, self.bits)
        self.slots = device.empty(along, np.int32, what)
        self._listed = device.empty(n_bricks, np.int32, what)
        self._pool = device.empty((self.capacity, brick_voxels), np.float32, what)
        lanes = lanes_of(device, 1)
        self._defines = {**self._common.defines, **lanes, "CAPACITY": self.capacity}
        find, group = int(self._defines["FIND_LANES"]), int(lanes["LANES"])
        coarse = [-(-n // c) for n, c in zip(along, COARSE_BRICK, strict=True)]
        inputs = [self._common.cameras, self._common.reach, self._common.tiles]
        table = [self._common.table, self._common.geometry]
        self._find = device.launch(
            device.kernel("occupancy", "find_bricks", **self._defines),
            (coarse[2] * find, coarse[1], coarse[0]),
            (find, 1, 1),
            *inputs,
            *table,
            self.slots,
            self._listed,
            self.n_active,
        )
        groups = min(n_bricks, 16 * device.info.compute_units if device.is_gpu else 64)
        self._launch = device.launch(
            device.kernel("occupancy", "sparse_occupancy", **self._defines),
            (groups * group,),
            (group,),
            *inputs,
            evidence,
            *table,
            self._listed,
            self.n_active,
            self._pool,
            self.bits,
        )

    def place(self, grid: VoxelGrid) -> None:
        """Move to a grid of the same shape."""
        self._common.place(grid)

    def __call__(self) -> None:
        self.bits.fill(0)
        self._common()
        self._find()
        self._launch()
        self.list()

    def surface_probability(self, count: int) -> np.ndarray:
        """(count,) float32 probabilities of the surface voxels, downloaded. Raises UserError if
        there was no room for them."""
        self.check_room()
        out = self._device.empty(max(count, 1), np.float32, "the surface's probability")
        arrays = (self._pool, self.slots, self.list.indices, self.list.count, out)
        kernel = self._device.kernel("occupancy", "sparse_gather", **self._defines)
        self._device.launch(kernel, (4096,), (64,), *arrays)()
        return out.get(count)

    @property
    def probability(self) -> Array:
        """(nx, ny, nz) float32 smoothed probability of the latest frame, 0 where no brick was
        worked on; a new array each time. Raises UserError if that does not fit the device."""
        self.check_room()
        nx, ny, nz = self._shape
        probability = self._device.empty(self._shape, np.float32, "the whole grid's probability")
        kernel = self._device.kernel("occupancy", "spread", **self._defines)
        self._device.launch(
            kernel,
            (nz, ny, nx),
            row_group(self._device, nz),
            self._pool,
            self.slots,
            probability,
        )()
        return probability

    def check_room(self) -> None:
        """Raise UserError if more bricks can be occupied than there is room for (waits)."""
        n = int(self.n_active.get()[0])
        if n > self.capacity:
            raise UserError(
                f"{n:,} bricks of the sparse grid can be occupied; expected at most "
                f"{self.capacity:,} (are the silhouettes full of noise?)"
            )

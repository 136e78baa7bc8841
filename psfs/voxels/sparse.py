"""Surface voxels from evidence, computed only in the bricks that can be occupied, coarse to
fine."""

from __future__ import annotations

import logging
import math

import numpy as np

from cl import Array, Launch
from cl.array import get_together
from cl.signature import Argument
from cl.workgroups import row_group, size_defines
from psfs.voxels.bricks import (
    BRICK,
    BRICK_DEFINES,
    COARSE_BRICK,
    Bricks,
    count_bricks,
    lane_defines,
)
from psfs.voxels.surface import ROOM, SurfaceList

log = logging.getLogger(__name__)


class SparseSurface:
    """Computation of surface voxels from evidence maps: occupancy (Song et al. eq. 3-9) and
    smoothing only where a voxel can be occupied.

    For each brick of 8 x 8 x 16 voxels, the greatest evidence that each camera can add to a voxel
    in it or within two voxels of it is summed over the cameras. If the sum is below the threshold,
    the brick is left out. The bound is conservative: the occupied voxels, and the probability of
    them and of their neighbours, are those of a whole grid to the last bit; elsewhere the
    probability counts as 0. Coarse bricks of 32 x 32 x 32 voxels are tested first; the list of
    bricks stays on the device.

    list: the surface of the voxels above the threshold. n_active: (1,) int32 number of computed
    bricks. Memory grows with the occupied space: 512^3 voxels take 90 MiB.
    """

    def __init__(self, bricks: Bricks) -> None:
        device, shape = bricks.device, bricks.shape
        self._bricks, self.n_active, self._warned = bricks, bricks.n_active, False
        along, size = count_bricks(shape), math.prod(shape)
        n_bricks, brick_voxels = math.prod(along), math.prod(BRICK)
        self.capacity = min(n_bricks, max(ROOM, size // 8) // brick_voxels)
        what = f"a sparse grid of {size:,} voxels"
        self._bits = device.zeros((*shape[:2], along[2]), np.uint16, what)
        self.list = SurfaceList(device, shape, self._bits, bricks.closed_surface)
        self.slots = device.empty(along, np.int32, what)
        self._listed = device.empty(n_bricks, np.int32, what)
        self._pool = device.empty((self.capacity, brick_voxels), np.float32, what)
        self._stored: dict[str, Argument] = {"grid": shape, "capacity": self.capacity}
        self._stored |= {"pool": self._pool, "slots": self.slots}
        lanes = lane_defines(device)
        defines = {**bricks.defines, **lanes}
        find, group = int(defines["FIND_LANES"]), int(lanes["LANES"])
        coarse = [-(-n // c) for n, c in zip(along, COARSE_BRICK, strict=True)]
        inputs = bricks.inputs | {"bricks": self._listed, "n_active": self.n_active}
        self._find = device.launch(
            device.kernel("reconstruction/occupancy", "find_bricks", **defines),
            (coarse[2] * find, coarse[1], coarse[0]),
            (find, 1, 1),
            **inputs,
            threshold=bricks.threshold,
            slots=self.slots,
            bits=self._bits,
        )
        groups = min(n_bricks, 16 * device.info.compute_units if device.is_gpu else 64)
        self._launch = device.launch(
            device.kernel("reconstruction/occupancy", "sparse_occupancy", **defines),
            (groups * group,),
            (group,),
            **inputs,
            threshold=bricks.threshold,
            evidence=bricks.evidence,
            capacity=self.capacity,
            pool=self._pool,
            bits=self._bits,
        )
        sizes = size_defines(device, grid=shape)
        self._gather, self._spread = (
            device.kernel("reconstruction/pool", name, **BRICK_DEFINES, **sizes)
            for name in ("sparse_gather", "spread")
        )
        #: Room for the surface's probabilities, and the launch that fills it.
        self._gathered: tuple[Array, Launch] | None = None

    def __call__(self) -> None:
        self._bricks()
        self._find()
        self._launch()
        self.list()

    def download(self) -> tuple[np.ndarray, np.ndarray, int]:
        """Download the indices (N,) int32 of the surface voxels and their probabilities (N,)
        float32, and return the number of occupied voxels. Where memory did not suffice,
        probabilities are the threshold, with a warning. Raises InputError as
        `SurfaceList.read_counts` does."""
        count, occupied, n_active = self.list.read_counts(self.n_active)
        self._warn_of_room(n_active)
        if self._gathered is None or self._gathered[0].size < count:
            device = self._bricks.device
            found = device.empty(max(1, 2 * count), np.float32, "the surface's probability")
            gather = device.launch(
                self._gather, (4096,), (64,), **self._stored, threshold=self._bricks.threshold,
                indices=self.list.indices, n_surface=self.list.count, out=found,
            )  # fmt: skip
            self._gathered = found, gather
        found, gather = self._gathered
        gather()
        parts = [array.region(0, (count,), array.dtype) for array in (self.list.indices, found)]
        indices, probability = get_together(parts)
        return indices, probability, occupied

    @property
    def probability(self) -> Array:
        """Smoothed probability (nx, ny, nz) float32 of the latest frame, a new array each time.

        It is 0 where no brick was computed or where memory did not suffice; the latter gives a
        warning. Raises InputError if the array does not fit into the device's memory.
        """
        self._warn_of_room(int(self.n_active.get()[0]))
        device, (nx, ny, nz) = self._bricks.device, self._bricks.shape
        probability = device.empty((nx, ny, nz), np.float32, "the whole grid's probability")
        device.launch(
            self._spread,
            (nz, ny, nx),
            row_group(device),
            **self._stored,
            probability=probability,
        )()
        return probability

    def _warn_of_room(self, n: int) -> None:
        """Warn once if more bricks, `n`, can be occupied than there is memory for."""
        if n > self.capacity and not self._warned:
            self._warned = True
            log.warning(
                "%s bricks of the sparse grid can be occupied; only %s have room for their "
                "probability: the silhouettes are full of noise",
                f"{n:,}",
                f"{self.capacity:,}",
            )

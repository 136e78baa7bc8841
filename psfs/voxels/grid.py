"""The voxel grid (geometry only) and the voxel cloud."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cl import InputError
from psfs.common.ranges import FARTHEST
from psfs.voxels.config import VOXEL_EDGES


@dataclass(frozen=True, eq=False)
class VoxelGrid:
    """A box of cubic voxels. C order, z fastest: voxel (i, j, k) has index (i ny + j) nz + k.

    origin: (3,) lowest corner, m. voxel_size: edge, m. shape: (nx, ny, nz).
    """

    origin: np.ndarray
    voxel_size: float
    shape: tuple[int, int, int]

    def __post_init__(self) -> None:
        object.__setattr__(self, "origin", np.asarray(self.origin, np.float64).reshape(3))
        object.__setattr__(self, "shape", tuple(int(n) for n in self.shape))
        if len(self.shape) != 3 or min(self.shape) < 1:
            raise InputError(f"the grid has shape {self.shape}; expected three positive numbers")
        if not VOXEL_EDGES[0] <= self.voxel_size <= VOXEL_EDGES[1]:
            raise InputError(
                f"the voxel size is {self.voxel_size:g} m; expected {VOXEL_EDGES[0]:g} to "
                f"{VOXEL_EDGES[1]:g}"
            )
        if not (np.abs(self.origin) <= FARTHEST).all():
            raise InputError(
                f"the grid's origin is {self.origin}; expected metres, up to {FARTHEST:g}"
            )

    @classmethod
    def covering(cls, low: np.ndarray, high: np.ndarray, voxel_size: float) -> VoxelGrid:
        """Return the smallest grid of `voxel_size` that holds the box from `low` to `high`, m."""
        low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
        if np.any(high <= low):
            raise InputError(f"the volume from {low} to {high} is empty; expected low < high")
        if not VOXEL_EDGES[0] <= voxel_size <= VOXEL_EDGES[1]:
            return cls(low, float(voxel_size), (1, 1, 1))  # the constructor raises
        shape = np.maximum(1, np.ceil((high - low) / voxel_size - 1e-9)).astype(int)
        return cls(low, float(voxel_size), (int(shape[0]), int(shape[1]), int(shape[2])))

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    def congruent(self, other: VoxelGrid) -> bool:
        """Return whether another grid has as many voxels along each axis, and voxels of the same
        size."""
        return self.shape == other.shape and self.voxel_size == other.voxel_size

    def equals(self, other: VoxelGrid) -> bool:
        """Return whether another grid has the same voxels at the same places."""
        return self.congruent(other) and bool(np.array_equal(self.origin, other.origin))

    @property
    def low(self) -> np.ndarray:
        return self.origin

    @property
    def high(self) -> np.ndarray:
        return self.origin + self.voxel_size * np.array(self.shape)

    def centres(self, indices: np.ndarray | None = None) -> np.ndarray:
        """Return centres (N, 3) m of the voxels with flat `indices` (N,), or of all of them."""
        if indices is None:
            centres = np.empty((*self.shape, 3))  # a tenth of the time of unravelled indices
            for axis, along in enumerate(np.ix_(*map(np.arange, self.shape))):
                centres[..., axis] = self.origin[axis] + (along + 0.5) * self.voxel_size
            return centres.reshape(-1, 3)
        ijk = np.stack(np.unravel_index(indices, self.shape), -1)
        return self.origin + (ijk + 0.5) * self.voxel_size


def check_size(grid: VoxelGrid) -> None:
    """Raise InputError if flat indices into the grid, padded by one voxel, exceed 32 bits."""
    if math.prod(n + 2 for n in grid.shape) >= 2**31:
        raise InputError(f"the grid has {grid.size:,} voxels; expected fewer than 2^31")


@dataclass(frozen=True, eq=False)
class VoxelCloud:
    """The surface voxels of one frame.

    indices: (N,) int32 flat indices into `grid`, ascending. probability: (N,) float32 smoothed
    occupancy. colour: (N, 3) uint8 RGB, or None if it was not requested. volume: m^3 of all
    occupied voxels, including the inner ones.
    """

    grid: VoxelGrid
    indices: np.ndarray
    probability: np.ndarray
    colour: np.ndarray | None = None
    volume: float = 0.0

    def __len__(self) -> int:
        return len(self.indices)

    @property
    def nbytes(self) -> int:
        """Size of the arrays, bytes."""
        colour = 0 if self.colour is None else self.colour.nbytes
        return self.indices.nbytes + self.probability.nbytes + colour

    @property
    def centres(self) -> np.ndarray:
        """Centres (N, 3) of the voxels, m."""
        return self.grid.centres(self.indices)

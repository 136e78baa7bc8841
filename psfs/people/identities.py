"""Decide which trajectories belong to one person, and which are people at all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psfs.people.coarse_voxels import measure_similarity
from psfs.people.following import (
    APART,
    LOWEST,
    PRESENT,
    REACH,
    SPEED,
    TALL,
    Trajectory,
    find_middle,
)
from psfs.voxels.grid import VoxelGrid

#: A trajectory that begins so soon, s, after another one's end, and nearer than two people can be,
#: goes on with it, whatever its colours.
_SOON = 0.5
#: Least similarity (Bhattacharyya coefficient) of the colours of two trajectories of one person.
_LIKENESS = 0.45
#: Least volume of a second person, as share of the largest one's: a child of 1.15 m beside a tall
#: man has 0.28.
_LEAST_SHARE = 0.2
#: Frames that measure the height of a trajectory, and the share of them in which somebody may
#: crouch.
_LOOKS, _CROUCHING = 15, 0.8


def count_voxels(one: Trajectory) -> float:
    """Return the median number of voxels."""
    return float(np.median([len(of) for of in one.voxels.values()])) if one.voxels else 0.0


def join_returning(ones: Sequence[Trajectory], grid: VoxelGrid, fps: float) -> list[Trajectory]:
    """Join trajectories of one person who left and came back, or was lost for some frames: the
    most alike first, until none is left."""
    ones = sorted(ones, key=lambda one: int(one.frames[0]))
    while True:
        costs = np.full((len(ones), len(ones)), np.inf)
        for i, early in enumerate(ones):
            for j, late in enumerate(ones):
                if early.frames[-1] < late.frames[0]:
                    costs[i, j] = _measure_cost(early, late, grid, fps)
        if not np.isfinite(costs).any():
            return ones
        i, j = divmod(int(costs.argmin()), len(ones))
        joined, other = ones[i], ones.pop(j)
        joined.voxels.update(other.voxels)
        joined.colours.update(other.colours)


def _measure_cost(early: Trajectory, late: Trajectory, grid: VoxelGrid, fps: float) -> float:
    """Return how unlike both are, infinity where they cannot be the same person."""
    last, first = int(early.frames[-1]), int(late.frames[0])
    seconds = (first - last) / fps
    ends = grid.centres(early.voxels[last]), grid.centres(late.voxels[first])
    apart = float(np.linalg.norm(find_middle(ends[0]) - find_middle(ends[1])))
    if apart > SPEED * seconds + REACH:
        return np.inf
    alike = measure_similarity(early.sum_colours(), late.sum_colours())
    at_once = seconds < _SOON and apart < APART
    return 1 - alike if at_once or alike >= _LIKENESS else np.inf


def is_person(one: Trajectory, grid: VoxelGrid, largest: float) -> bool:
    """Return whether a trajectory is a second person beside one of `largest` volume."""
    low = np.median(_find_ends(one, grid)[:, 0]) <= LOWEST
    return bool(low and count_voxels(one) >= _LEAST_SHARE * largest and is_tall(one, grid))


def is_tall(one: Trajectory, grid: VoxelGrid) -> bool:
    """Return whether a trajectory is as high as a person in a fifth of its frames: a trolley, a
    ball or a dog never are, and people who crouch stand up at some time."""
    low, high = _find_ends(one, grid).T
    return bool(np.quantile(high - low, _CROUCHING) + grid.voxel_size >= TALL)


def _find_ends(one: Trajectory, grid: VoxelGrid) -> np.ndarray:
    """Return the lowest and highest voxel (_LOOKS, 2), m, in frames all over a trajectory."""
    picked = one.frames[np.linspace(0, len(one.frames) - 1, _LOOKS).round().astype(int)]
    heights = [grid.centres(one.voxels[int(index)])[:, 2] for index in picked]
    return np.array([(of.min(), of.max()) for of in heights])


def find_present_frames(one: Trajectory) -> np.ndarray:
    """Return the frames (F,) in which enough of the person is seen."""
    least = PRESENT * count_voxels(one)
    return np.array([index for index in one.frames if len(one.voxels[int(index)]) >= least], int)

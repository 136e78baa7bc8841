"""Decide which trajectories belong to one person, and which are people at all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import TypeVar

import numpy as np

from psfs.common.numbers import match_pairs
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

T = TypeVar("T")

#: A trajectory that begins so soon, s, after another one's end, and nearer than two people can be,
#: goes on with it, whatever its colours and size.
_SOON = 0.5
#: Least similarity (Bhattacharyya coefficient) of the colours, and greatest difference of the
#: logarithms of the volumes, of two trajectories of one person.
_LIKENESS, _SIZE = 0.45, 0.7
#: Weights of that difference and of the distance, 1/m, up to 1 m, beside the unlikeness of colours.
_SIZE_WEIGHT, _DISTANCE_WEIGHT = 0.3, 0.2
#: Least gain of similarity, summed over both, for two trajectories to be exchanged.
_SWAP_GAIN = 0.1
#: Least volume of a second person, as share of the largest one's: a child of 1.15 m beside a tall
#: man has 0.28.
_LEAST_SHARE = 0.2
#: Least share of a second person's silhouettes, in some camera, that nobody else explains: a hull
#: of several people has parts that nothing fills.
_UNEXPLAINED = 0.15
#: Share of frames with contact above which a trajectory may be part of another person.
_CONTACT = 0.9
#: Frames that measure the height of a trajectory, and the share of them in which somebody may
#: crouch.
_LOOKS, _CROUCHING = 15, 0.8


def count_voxels(one: Trajectory) -> float:
    """Return the median number of voxels."""
    return float(np.median([len(of) for of in one.voxels.values()])) if one.voxels else 0.0


def undo_swaps(ones: Sequence[Trajectory], window: float) -> None:
    """Exchange two trajectories from a contact on, where their colours before and after it, within
    `window` frames, say that they were mistaken for one another."""
    for first, second in combinations(ones, 2):
        for start, stop in _find_contacts(first.touching & second.touching, window / 4):
            before, after = (start - window, start - 1), (stop + 1, stop + window)
            a, b = (one.sum_colours(*before) for one in (first, second))
            c, d = (one.sum_colours(*after) for one in (first, second))
            if not all(of.any() for of in (a, b, c, d)):
                continue
            kept = measure_similarity(a, c) + measure_similarity(b, d)
            if measure_similarity(a, d) + measure_similarity(b, c) > kept + _SWAP_GAIN:
                _exchange_after(first.voxels, second.voxels, stop)
                _exchange_after(first.colours, second.colours, stop)
                _exchange_after(first.unexplained, second.unexplained, stop)


def _find_contacts(touching: Iterable[int], gap: float) -> list[tuple[int, int]]:
    """Return the first and last frame of every contact; those closer than `gap` are one."""
    frames = np.array(sorted(touching), int)
    if not len(frames):
        return []
    runs = np.split(frames, np.flatnonzero(np.diff(frames) > max(1.0, gap)) + 1)
    return [(int(run[0]), int(run[-1])) for run in runs]


def _exchange_after(first: dict[int, T], second: dict[int, T], after: int) -> None:
    late = [{index: of for index, of in one.items() if index > after} for one in (first, second)]
    for one, own, other in ((first, *late), (second, *late[::-1])):
        for index in own:
            del one[index]
        one.update(other)


def join_returning(ones: Sequence[Trajectory], grid: VoxelGrid, fps: float) -> list[Trajectory]:
    """Join trajectories of one person who left and came back, or was lost for some frames: the
    most alike first (Hungarian method), again until none is left."""
    ones = sorted(ones, key=lambda one: int(one.frames[0]))
    while True:
        costs = np.full((len(ones), len(ones)), np.inf)
        for i, early in enumerate(ones):
            for j, late in enumerate(ones):
                if early.frames[-1] < late.frames[0]:
                    costs[i, j] = _measure_cost(early, late, grid, fps)
        pairs = match_pairs(costs)
        if not pairs:
            return ones
        i, j = min(pairs, key=lambda pair: costs[pair])
        joined, other = ones[i], ones.pop(j)
        joined.voxels.update(other.voxels)
        joined.touching.update(other.touching)
        joined.colours.update(other.colours)
        joined.unexplained.update(other.unexplained)


def _measure_cost(early: Trajectory, late: Trajectory, grid: VoxelGrid, fps: float) -> float:
    """Return how unlike both are, infinity where they cannot be the same person."""
    last, first = int(early.frames[-1]), int(late.frames[0])
    seconds = (first - last) / fps
    ends = grid.centres(early.voxels[last]), grid.centres(late.voxels[first])
    apart = float(np.linalg.norm(find_middle(ends[0]) - find_middle(ends[1])))
    if apart > SPEED * seconds + REACH:
        return np.inf
    alike = measure_similarity(early.sum_colours(), late.sum_colours())
    size = abs(np.log(count_voxels(early) / count_voxels(late)))
    at_once = seconds < _SOON and apart < APART
    if not at_once and (alike < _LIKENESS or size > _SIZE):
        return np.inf
    return 1 - alike + _SIZE_WEIGHT * size + min(apart, 1.0) * _DISTANCE_WEIGHT


def is_person(one: Trajectory, grid: VoxelGrid, largest: float) -> bool:
    """Return whether a trajectory is a second person beside one of `largest` volume."""
    if count_voxels(one) < _LEAST_SHARE * largest:
        return False
    if np.median(_find_ends(one, grid)[:, 0]) > LOWEST:
        return False
    shares = list(one.unexplained.values())
    explained = bool(shares) and float(np.median(shares)) < _UNEXPLAINED
    return is_tall(one, grid) and not explained


def is_part(one: Trajectory, others: Iterable[Trajectory], grid: VoxelGrid) -> bool:
    """Return whether a trajectory is a part of one of the `others`: it touches somebody in nearly
    all frames, and is nearer to them than two people can be."""
    if len(one.touching) <= _CONTACT * len(one.voxels):
        return False
    apart = []
    for index in sorted(one.touching):
        rest = [of.voxels[index] for of in others if index in of.touching and index in of.voxels]
        if index in one.voxels and rest:
            middles = [find_middle(grid.centres(own)) for own in rest]
            own = find_middle(grid.centres(one.voxels[index]))
            apart.append(np.linalg.norm(own - middles, axis=1).min())
    return not apart or float(np.median(apart)) < APART


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

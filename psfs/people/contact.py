"""Division of a frame's surface voxels among people, those who touch included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.spatial import cKDTree

from psfs.people.config import SeparationConfig
from psfs.people.following import find_middle
from psfs.people.people import People
from psfs.voxels.grid import VoxelCloud

#: Least distance of coarse voxels, in edges, that do not touch: beyond the diagonal of a cube.
_TOUCH = 1.8


@dataclass(frozen=True, eq=False)
class SplitCloud:
    """Centres (N, 3) m of surface voxels.

    clouds: of each person, with what may be their arm, and at the end of nobody. sole: of these, in
    the same order, what can only be theirs. near: for each person, what lies so near to them in
    the trunk of somebody they touch that their hand may be before it.
    """

    clouds: list[np.ndarray]
    sole: list[np.ndarray]
    near: list[np.ndarray]


#: Two people by their numbers: the voxels of the first may be the second one's arm.
Pair = tuple[int, int]


def find_contacts(people: People, fps: float, config: SeparationConfig) -> dict[int, list[Pair]]:
    """Return the pairs who touch, by frame, `fps` per second, for `config.lasting` s on end."""
    n_least = max(1, round(config.lasting * fps))
    running: dict[Pair, list[int]] = {}
    found: dict[int, list[Pair]] = {index: [] for index in people.frames}
    for index in [*people.frames, None]:
        pairs = [] if index is None else _find_pairs(people, index, config.apart)
        for pair in [pair for pair in running if pair not in pairs]:
            frames = running.pop(pair)
            for frame in frames if len(frames) >= n_least else ():
                found[frame].append(pair)
        for pair in pairs if index is not None else ():
            running.setdefault(pair, []).append(index)
    return found


def split_cloud(
    cloud: VoxelCloud,
    people: People,
    index: int,
    config: SeparationConfig,
    pairs: Sequence[Pair] = (),
) -> SplitCloud:
    """Give each surface voxel of frame `index` to the person with the nearest coarse voxels, or to
    nobody if it is farther than `config.near` m from all, and of `pairs` who touch also to those
    whose arm it may be."""
    points = cloud.centres
    nearest = np.full((len(people) + 1, len(points)), np.inf)
    nearest[-1] = config.near
    trees: dict[int, cKDTree] = {}
    for number, person in enumerate(people):
        if index in person.voxels:
            trees[number] = cKDTree(people.grid.centres(person.voxels[index]))
            bound = max(2 * config.near, config.reach)
            nearest[number] = trees[number].query(points, distance_upper_bound=bound)[0]
    owned = nearest.argmin(0) == np.arange(len(nearest))[:, None]
    shared, near = np.zeros_like(owned), np.zeros_like(owned)
    for one, other in pairs:
        coarse = trees[one].data
        high = points[:, 2] > config.arms * coarse[:, 2].max()
        reached = owned[one] & high & (nearest[other] < config.reach)
        outside = np.linalg.norm(points[:, :2] - find_middle(coarse), axis=1) > config.core
        shared[other] |= reached & outside
        near[other] |= reached & ~outside
    if not (shared.any() or near.any()):
        clouds = [points[row] for row in owned]
        return SplitCloud(clouds, clouds, [points[:0]] * len(people))
    sole = owned & ~shared.any(0)
    return SplitCloud(
        *([points[row] for row in rows] for rows in (owned | shared, sole, near[:-1]))
    )


def _find_pairs(people: People, index: int, apart: float) -> list[Pair]:
    """Return the pairs of people, in both orders, with coarse voxels that touch in a frame and axes
    at least `apart` m from each other."""
    touch = _TOUCH * people.grid.voxel_size
    trees = {
        number: cKDTree(people.grid.centres(person.voxels[index]))
        for number, person in enumerate(people)
        if index in person.voxels
    }
    return [
        (one, other)
        for one, other in permutations(trees, 2)
        if np.linalg.norm(find_middle(trees[one].data) - find_middle(trees[other].data)) >= apart
        and trees[one].query(trees[other].data, distance_upper_bound=touch)[0].min() < touch
    ]

"""Division of a frame's surface voxels among people, those who touch included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import scipy

from psfs.people.following import find_middle
from psfs.people.people import People
from psfs.voxels.grid import VoxelCloud

#: Distance from a person's coarse voxels up to which voxels are theirs, and that up to which voxels
#: of somebody they touch may be their arm, m.
_NEAR, ARM_REACH = 0.2, 0.35
#: Distance from a person's axis within which voxels are no arm of others, m; and height above which
#: they may be, as share of the person's.
_CORE, _ARMS = 0.28, 0.4
#: Least distance, m, of the axes of people whose arms are looked for on both sides (between those
#: who walk abreast more nearly, each one's own arms hang), and time, s, for which they touch.
_APART, _LASTING = 0.63, 0.2
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


def find_contacts(people: People, fps: float, lasting: float = _LASTING) -> dict[int, list[Pair]]:
    """Return the pairs who touch, by frame, `fps` per second, for `lasting` s on end."""
    n_least = max(1, round(lasting * fps))
    running: dict[Pair, list[int]] = {}
    found: dict[int, list[Pair]] = {index: [] for index in people.frames}
    for index in [*people.frames, None]:
        pairs = [] if index is None else _find_pairs(people, index, _APART)
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
    pairs: Sequence[Pair] = (),
) -> SplitCloud:
    """Give each surface voxel of frame `index` to the person with the nearest coarse voxels, or to
    nobody if it is farther than 0.2 m from all, and of `pairs` who touch also to those
    whose arm it may be."""
    points = cloud.centres
    nearest = np.full((len(people) + 1, len(points)), np.inf)
    nearest[-1] = _NEAR
    trees: dict[int, scipy.spatial.cKDTree] = {}
    for number, person in enumerate(people):
        if index in person.voxels:
            trees[number] = scipy.spatial.cKDTree(people.grid.centres(person.voxels[index]))
            bound = max(2 * _NEAR, ARM_REACH)
            nearest[number] = trees[number].query(points, distance_upper_bound=bound)[0]
    owned = nearest.argmin(0) == np.arange(len(nearest))[:, None]
    shared, near = np.zeros_like(owned), np.zeros_like(owned)
    for one, other in pairs:
        coarse = trees[one].data
        high = points[:, 2] > _ARMS * coarse[:, 2].max()
        reached = owned[one] & high & (nearest[other] < ARM_REACH)
        outside = np.linalg.norm(points[:, :2] - find_middle(coarse), axis=1) > _CORE
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
        number: scipy.spatial.cKDTree(people.grid.centres(person.voxels[index]))
        for number, person in enumerate(people)
        if index in person.voxels
    }
    return [
        (one, other)
        for one, other in permutations(trees, 2)
        if np.linalg.norm(find_middle(trees[one].data) - find_middle(trees[other].data)) >= apart
        and trees[one].query(trees[other].data, distance_upper_bound=touch)[0].min() < touch
    ]

"""Assign the persons in the pictures of several cameras to people, in space or in the voxels.

Who is followed takes in every camera the person that lies nearest to where the last points of the
body are projected, all at once (Hungarian method). The others are matched between cameras by
epipolar geometry: the pair of persons whose points triangulate best (Hartley & Sturm 1997) and that
most cameras confirm is somebody new, or somebody who comes back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations, pairwise

import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.cameras.triangulation import (
    TriangulationConfig,
    reprojection_errors,
    triangulate,
    triangulate_rays,
    undistort_points,
)
from psfs.common.numbers import STEP_SECONDS, find_best_path, match_pairs
from psfs.people.following import SPEED
from psfs.people.people import People, Person
from psfs.voxels.grid import VoxelGrid

#: Median distances, as shares of a person's size in the picture: up to which persons of different
#: cameras are the same, and of a person in a picture from where somebody was last seen.
_LARGEST_ERROR, _FOLLOWED = 0.06, 0.3
#: Fewest points that persons in two cameras must share.
_LEAST_POINTS = 5
#: Distance, m, of the mean of a person's keypoints from the middle of somebody's voxels up to which
#: both may be of one person.
_FROM_VOXELS = 0.6


@dataclass(eq=False)
class _Person:
    """Somebody in space: chosen (V,) person of each camera, -1 for none, by frame; points (K, 3) m
    as last seen."""

    points: np.ndarray
    chosen: dict[int, np.ndarray] = field(default_factory=dict)

    @property
    def last(self) -> int:
        """The latest frame in which somebody is seen."""
        return next(reversed(self.chosen))


def associate_people(
    points: np.ndarray,
    rig: CameraRig,
    fps: float,
    number: int | None = None,
) -> list[np.ndarray]:
    """Return the keypoints (V, F, K, 3) of each of several people, NaN where unseen, the
    longest seen first.

    points: (V, F, N, K, 3) px of N persons in each picture, in any order, with confidences; NaN
    where missing. number: the greatest number of people, if it is known.
    """
    search = _Search(points, rig, fps, number)
    for frame in range(points.shape[1]):
        search.step(frame)
    people = sorted(search.people, key=lambda person: len(person.chosen), reverse=True)
    least = STEP_SECONDS * fps
    least = max(1, min(least, points.shape[1]))
    lasting = [person for person in people if len(person.chosen) >= least]
    return [_pick(points, person) for person in lasting[:number]]


def count_at_once(people: Sequence[np.ndarray], least: float) -> int:
    """Return how many of `people`, keypoints (V, F, K, 3) each, two cameras show at once in at
    least `least` frames."""
    if not people:
        return 0
    several = [(np.isfinite(person).all(-1).any(-1).sum(0) > 1) for person in people]
    of_frames = np.sort(np.sum(several, axis=0))[::-1]
    return int(of_frames[min(max(1, round(least)), len(of_frames)) - 1])


def choose_person(points: np.ndarray, rig: CameraRig | None, fps: float) -> np.ndarray:
    """Return the keypoints (V, F, K, 3) of one of N persons (V, F, N, K, 3): of the people whom
    cameras see alike the one with the surest and largest keypoints; without cameras, or if there is
    nobody, of each camera's own choice (Viterbi) the persons that are sure and large and move
    little."""
    if points.shape[2] == 1:
        return points[:, :, 0]
    people = [] if rig is None else associate_people(points, rig, fps)
    if people:
        return max(people, key=lambda own: float(_score_persons(own[:, :, None]).sum()))
    sizes, scores = person_sizes(points), _score_persons(points)
    chosen = np.zeros(points.shape[:2], int)
    for view, score in enumerate(scores / np.maximum(scores.max((1, 2), keepdims=True), 1e-9)):
        there = np.flatnonzero(score.any(-1)).tolist()
        if len(there):
            steps = [_measure_steps(points[view], sizes[view], *pair) for pair in pairwise(there)]
            changes = np.reshape(steps, (-1, points.shape[2], points.shape[2])) / _FOLLOWED
            chosen[view, there] = find_best_path(
                np.where(score > 0, -score, np.inf)[there], changes
            )
    return np.take_along_axis(points, chosen[:, :, None, None, None], 2)[:, :, 0]


def _score_persons(points: np.ndarray) -> np.ndarray:
    """Return the confidences of persons (V, F, N, K, 3), summed, by the roots of their sizes."""
    return np.nan_to_num(points[..., 2]).sum(-1) * np.sqrt(person_sizes(points))


def person_sizes(points: np.ndarray) -> np.ndarray:
    """Return the diagonals (V, F, N) px of the persons' bounding boxes; 1 for missing persons."""
    pixels = points[..., :2]
    sides = np.fmax.reduce(pixels, axis=-2) - np.fmin.reduce(pixels, axis=-2)
    return np.fmax(np.hypot(sides[..., 0], sides[..., 1]), 1.0)


def _measure_steps(points: np.ndarray, sizes: np.ndarray, before: int, after: int) -> np.ndarray:
    """Return the distances (N, N) between the persons (F, N, K, 3) of two frames, medians over the
    points as shares of their sizes (F, N), at most 1; 1 if they have none in common."""
    apart = points[before][:, None, :, :2] - points[after][None, :, :, :2]
    away = np.linalg.norm(apart, axis=-1)
    none = np.isnan(away).all(-1)
    steps = np.nanmedian(np.where(none[..., None], np.inf, away), axis=-1)
    return np.minimum(steps / np.sqrt(sizes[before][:, None] * sizes[after][None]), 1.0)


def _pick(points: np.ndarray, person: _Person) -> np.ndarray:
    """Return a person's keypoints (V, F, K, 3)."""
    picked = np.full((*points.shape[:2], *points.shape[3:]), np.nan)
    for frame, chosen in person.chosen.items():
        for view in np.flatnonzero(chosen >= 0):
            picked[view, frame] = points[view, frame, chosen[view]]
    return picked


class _Search:
    """The people found so far, and the pictures of all frames."""

    def __init__(
        self,
        points: np.ndarray,
        rig: CameraRig,
        fps: float,
        number: int | None,
    ) -> None:
        self.rig, self.fps, self.number = rig, fps, number
        self.straight = undistort_points(rig, points)
        self.sizes = person_sizes(self.straight)
        self.there = np.isfinite(self.straight).all(-1).sum(-1) >= _LEAST_POINTS
        self.people: list[_Person] = []

    def step(self, frame: int) -> None:
        """Assign the persons of the next frame."""
        free = self.there[:, frame].copy()
        going = [one for one in self.people if frame - one.last <= STEP_SECONDS * self.fps]
        chosen = np.full((len(going), len(self.rig)), -1)
        for view in range(len(self.rig)):
            costs = np.array([self._away(one.points, view, frame) for one in going])
            if costs.size:
                costs[:, ~free[view]] = np.inf
            for k, n in match_pairs(costs, _FOLLOWED):
                chosen[k, view] = n
        for one, rows in zip(going, chosen, strict=True):
            joints = self._locate(rows, frame)
            if joints is None:
                continue
            one.points = np.where(np.isfinite(joints), joints, one.points)
            one.chosen[frame] = rows
            seen = np.flatnonzero(rows >= 0)
            free[seen, rows[seen]] = False
        while (new := self._find_new(frame, free)) is not None:
            seen = np.flatnonzero(new >= 0)
            free[seen, new[seen]] = False  # also of those that are left out then
            joints = self._locate(new, frame)
            if joints is not None:
                one = self._find_returning(joints, frame)
                one.points = joints
                one.chosen[frame] = new

    def _locate(self, rows: np.ndarray, frame: int) -> np.ndarray | None:
        """Take those of cameras that contradict the others out of the persons (V,) of a frame;
        return the points (K, 3) m of the rest, None if they are nobody."""
        joints = self._triangulate(rows, frame)
        for view in np.flatnonzero(rows >= 0).tolist():
            away = self._away(joints, view, frame)[rows[view]]
            if (rows >= 0).sum() > 2 and away > _LARGEST_ERROR:
                rows[view] = -1
        if (rows >= 0).sum() < 2:
            return None
        joints = self._triangulate(rows, frame)
        enough = np.isfinite(joints).all(-1).sum() >= _LEAST_POINTS
        return joints if enough else None

    def _find_returning(self, points: np.ndarray, frame: int) -> _Person:
        """Return who of those that are lost is nearest to the points (K, 3) m and can have come
        there, else somebody new."""
        middle = np.nanmean(points, axis=0)
        full = self.number is not None and len(self.people) >= self.number
        best, nearest = None, np.inf
        for one in self.people:
            if frame in one.chosen:
                continue
            apart = float(np.linalg.norm(np.nanmean(one.points, axis=0) - middle))
            reach = SPEED * (frame - one.last) / self.fps + 0.3
            if apart < nearest and (full or apart <= reach):
                best, nearest = one, apart
        if best is None:
            best = _Person(points)
            self.people.append(best)
        return best

    def _find_new(self, frame: int, free: np.ndarray) -> np.ndarray | None:
        """Return the free persons (V,) of the cameras that show one more person: of all pairs of
        persons that fit, the one that most cameras confirm, and then fits best; None if there is
        none."""
        needed = min(3, len(self.rig))
        best, rank = None, (needed - 1, 0.0)
        for first, second in combinations(range(len(self.rig)), 2):
            for a in np.flatnonzero(free[first]):
                for b in np.flatnonzero(free[second]):
                    rows = np.full(len(self.rig), -1)
                    rows[[first, second]] = a, b
                    error = self._complete(rows, frame, free)
                    if ((rows >= 0).sum(), -error) > rank and error < _LARGEST_ERROR:
                        best, rank = rows, (int((rows >= 0).sum()), -error)
        return best

    def _complete(self, rows: np.ndarray, frame: int, free: np.ndarray) -> float:
        """Add to a pair of persons (V,) those of the other cameras that fit; return the greatest
        distance, see `_away`."""
        pair = np.flatnonzero(rows >= 0).tolist()
        joints = self._triangulate(rows, frame)
        if np.isfinite(joints).all(-1).sum() < _LEAST_POINTS:
            return np.inf
        error = max(self._away(joints, view, frame)[rows[view]] for view in pair)
        for view in range(len(self.rig)):
            if rows[view] >= 0 or not free[view].any():
                continue
            away = np.where(free[view], self._away(joints, view, frame), np.inf)
            if away.min() < _LARGEST_ERROR:
                rows[view] = away.argmin()
                error = max(error, float(away.min()))
        return float(error)

    def _triangulate(self, rows: np.ndarray, frame: int) -> np.ndarray:
        """Return the points (K, 3) m of the persons (V,), NaN where cameras disagree."""
        seen = np.full((len(self.rig), *self.straight.shape[3:]), np.nan)
        sizes = []
        for view in np.flatnonzero(rows >= 0):
            seen[view] = self.straight[view, frame, rows[view]]
            sizes.append(self.sizes[view, frame, rows[view]])
        limit = 2 * _LARGEST_ERROR * float(np.median(sizes)) if sizes else 1.0
        return triangulate(self.rig, seen, TriangulationConfig(max_error=max(limit, 1.0))).points

    def _away(self, points: np.ndarray, view: int, frame: int) -> np.ndarray:
        """Return the median distances (N,) of a camera's persons from where it sees the points (K,
        3), as shares of their sizes; 1e3 without enough common points."""
        seen = self.straight[view, frame]
        camera = CameraRig((self.rig[view],))
        count, k = seen.shape[:2]
        joints = np.broadcast_to(points, (count, k, 3)).reshape(-1, 3)
        off = reprojection_errors(camera, seen.reshape(1, -1, 3), joints)[0].reshape(count, k)
        known = np.isfinite(off)
        least = _LEAST_POINTS
        median = np.array([np.median(row[fine]) if fine.sum() >= least else np.inf
                           for row, fine in zip(off, known, strict=True)])  # fmt: skip
        return np.minimum(median / self.sizes[view, frame], 1e3)


def match_to_people(points: np.ndarray, people: People, rig: CameraRig) -> list[np.ndarray]:
    """Return the keypoints (V, F, K, 3) of each of `people`, NaN in frames that have none near the
    voxels.

    points: (N, V, F, K, 3) of each person that was associated in the pictures. In every frame they
    are given to the people whose voxels are nearest (Hungarian method), up to
    `_FROM_VOXELS`: an identity that was exchanged in the pictures is not exchanged here.
    """
    matched = np.full((len(people), *points.shape[1:]), np.nan, np.float32)
    middles = np.stack([_middles(person, people.grid, points.shape[2]) for person in people])
    places = np.stack([_locate_person(one, rig) for one in points])
    apart = np.linalg.norm(places[:, None] - middles, axis=-1)
    for frame in np.flatnonzero(np.isfinite(apart).any((0, 1))):
        for k, person in match_pairs(apart[..., frame], _FROM_VOXELS):
            matched[person, :, frame] = points[k, :, frame]
    return list(matched)


def _middles(person: Person, grid: VoxelGrid, n_frames: int) -> np.ndarray:
    """Return the middles (F, 3) m of a person's voxels, NaN in frames that do not show them."""
    middles = np.full((n_frames, 3), np.nan)
    known = sorted(person.voxels)
    points = np.array([grid.centres(person.voxels[frame]).mean(0) for frame in known])
    frames = np.union1d(person.frames, known)
    middles[frames] = np.stack([np.interp(frames, known, along) for along in points.T], axis=1)
    return middles


def _locate_person(points: np.ndarray, rig: CameraRig) -> np.ndarray:
    """Return where the means of a person's keypoints (V, F, K, 3) in the pictures meet, (F, 3) m;
    NaN in frames that fewer than two cameras show."""
    seen = np.all(np.isfinite(points), axis=-1)
    with np.errstate(invalid="ignore"):
        means = np.where(seen[..., None], points, 0).sum(2) / seen.sum(2)[..., None]
    return triangulate_rays(rig, means[..., :2].astype(np.float64))

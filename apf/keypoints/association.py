"""Assign the persons in the pictures of several cameras to people in space.

Who is followed takes in every camera the person that lies nearest to where the last points of the
body are projected, all at once (Hungarian method). The others are matched between cameras by
epipolar geometry: the pair of persons whose points triangulate best (Hartley & Sturm 1997) and that
most cameras confirm is somebody new, or somebody who comes back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from apf.keypoints.config import AssociationConfig
from apf.keypoints.persons import person_sizes
from psfs.cameras.camera import CameraRig
from psfs.cameras.triangulation import (
    TriangulationConfig,
    reprojection_errors,
    triangulate,
    undistort_points,
)
from psfs.common.matching import match_pairs


@dataclass(eq=False)
class _Person:
    """Somebody in space: chosen (V,) person of each camera, -1 for none, by frame; points (K, 3) m
    as last seen in frame `last`."""

    points: np.ndarray
    last: int
    chosen: dict[int, np.ndarray] = field(default_factory=dict)

    def take(self, chosen: np.ndarray, frame: int) -> None:
        """Give somebody the persons (V,) of a frame."""
        self.chosen[frame] = chosen
        self.last = frame


def associate_people(
    points: np.ndarray,
    rig: CameraRig,
    fps: float,
    number: int | None = None,
    config: AssociationConfig | None = None,
) -> list[np.ndarray]:
    """Return the keypoints (V, F, K, 3) of each of several people, NaN where unseen, the
    longest seen first.

    points: (V, F, N, K, 3) px of N persons in each picture, in any order, with confidences; NaN
    where missing. number: the greatest number of people, if it is known.
    """
    search = _Search(points, rig, fps, number, config or AssociationConfig())
    for frame in range(points.shape[1]):
        search.step(frame)
    people = sorted(search.people, key=lambda person: len(person.chosen), reverse=True)
    least = search.config.least_seconds * fps
    least = max(1, min(least, points.shape[1]))
    lasting = [person for person in people if len(person.chosen) >= least]
    return [_pick(points, person) for person in lasting[:number]]


def count_at_once(people: Sequence[np.ndarray], least: float) -> int:
    """Return how many of `people`, keypoints (V, F, K, 3) each, two cameras show at once in at
    least `least` frames."""
    if not people:
        return 0
    shown = [(np.isfinite(own).all(-1).any(-1).sum(0) > 1) for own in people]
    of_frames = np.sort(np.sum(shown, axis=0))[::-1]
    return int(of_frames[min(max(1, round(least)), len(of_frames)) - 1])


def _pick(points: np.ndarray, person: _Person) -> np.ndarray:
    """Return a person's keypoints (V, F, K, 3)."""
    own = np.full((*points.shape[:2], *points.shape[3:]), np.nan)
    for frame, chosen in person.chosen.items():
        for view in np.flatnonzero(chosen >= 0):
            own[view, frame] = points[view, frame, chosen[view]]
    return own


class _Search:
    """The people found so far, and the pictures of all frames."""

    def __init__(
        self,
        points: np.ndarray,
        rig: CameraRig,
        fps: float,
        number: int | None,
        config: AssociationConfig,
    ) -> None:
        self.rig, self.fps, self.number, self.config = rig, fps, number, config
        self.straight = undistort_points(rig, points)
        self.sizes = person_sizes(self.straight)
        self.there = np.isfinite(self.straight).all(-1).sum(-1) >= config.least_points
        self.people: list[_Person] = []

    def step(self, frame: int) -> None:
        """Assign the persons of the next frame."""
        free = self.there[:, frame].copy()
        going = [
            one for one in self.people if frame - one.last <= self.config.longest_gap * self.fps
        ]
        chosen = np.full((len(going), len(self.rig)), -1)
        for view in range(len(self.rig)):
            costs = np.array([self._away(one.points, view, frame) for one in going])
            if costs.size:
                costs[:, ~free[view]] = np.inf
            for k, n in match_pairs(costs, self.config.followed):
                chosen[k, view] = n
        for one, own in zip(going, chosen, strict=True):
            found = self._locate(own, frame)
            if found is None:
                continue
            one.points = np.where(np.isfinite(found), found, one.points)
            one.take(own, frame)
            seen = np.flatnonzero(own >= 0)
            free[seen, own[seen]] = False
        while (new := self._find_new(frame, free)) is not None:
            seen = np.flatnonzero(new >= 0)
            free[seen, new[seen]] = False  # also of those that are left out then
            found = self._locate(new, frame)
            if found is not None:
                one = self._find_returning(found, frame)
                one.points = found
                one.take(new, frame)

    def _locate(self, own: np.ndarray, frame: int) -> np.ndarray | None:
        """Take those of cameras that contradict the others out of the persons (V,) of a frame;
        return the points (K, 3) m of the rest, None if they are nobody."""
        found = self._triangulate(own, frame)
        for view in np.flatnonzero(own >= 0).tolist():
            away = self._away(found, view, frame)[own[view]]
            if (own >= 0).sum() > 2 and away > self.config.largest_error:
                own[view] = -1
        if (own >= 0).sum() < 2:
            return None
        found = self._triangulate(own, frame)
        enough = np.isfinite(found).all(-1).sum() >= self.config.least_points
        return found if enough else None

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
            reach = self.config.speed * (frame - one.last) / self.fps + 0.3
            if apart < nearest and (full or apart <= reach):
                best, nearest = one, apart
        if best is None:
            best = _Person(points, frame)
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
                    own = np.full(len(self.rig), -1)
                    own[[first, second]] = a, b
                    error = self._complete(own, frame, free)
                    if ((own >= 0).sum(), -error) > rank and error < self.config.largest_error:
                        best, rank = own, (int((own >= 0).sum()), -error)
        return best

    def _complete(self, own: np.ndarray, frame: int, free: np.ndarray) -> float:
        """Add to a pair of persons (V,) those of the other cameras that fit; return the greatest
        distance, see `_away`."""
        pair = np.flatnonzero(own >= 0).tolist()
        found = self._triangulate(own, frame)
        if np.isfinite(found).all(-1).sum() < self.config.least_points:
            return np.inf
        error = max(self._away(found, view, frame)[own[view]] for view in pair)
        for view in range(len(self.rig)):
            if own[view] >= 0 or not free[view].any():
                continue
            away = np.where(free[view], self._away(found, view, frame), np.inf)
            if away.min() < self.config.largest_error:
                own[view] = away.argmin()
                error = max(error, float(away.min()))
        return float(error)

    def _triangulate(self, own: np.ndarray, frame: int) -> np.ndarray:
        """Return the points (K, 3) m of the persons (V,), NaN where cameras disagree."""
        seen = np.full((len(self.rig), *self.straight.shape[3:]), np.nan)
        sizes = []
        for view in np.flatnonzero(own >= 0):
            seen[view] = self.straight[view, frame, own[view]]
            sizes.append(self.sizes[view, frame, own[view]])
        limit = 2 * self.config.largest_error * float(np.median(sizes)) if sizes else 1.0
        return triangulate(self.rig, seen, TriangulationConfig(max_error=max(limit, 1.0))).points

    def _away(self, points: np.ndarray, view: int, frame: int) -> np.ndarray:
        """Return the median distances (N,) of a camera's persons from where it sees the points (K,
        3), as shares of their sizes; 1e3 without enough common points."""
        seen = self.straight[view, frame]
        camera = CameraRig((self.rig[view],))
        count, k = seen.shape[:2]
        shown = np.broadcast_to(points, (count, k, 3)).reshape(-1, 3)
        off = reprojection_errors(camera, seen.reshape(1, -1, 3), shown)[0].reshape(count, k)
        known = np.isfinite(off)
        least = self.config.least_points
        median = np.array([np.median(row[fine]) if fine.sum() >= least else np.inf
                           for row, fine in zip(off, known, strict=True)])  # fmt: skip
        return np.minimum(median / self.sizes[view, frame], 1e3)

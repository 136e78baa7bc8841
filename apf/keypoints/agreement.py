"""Check whether the cameras' keypoints are consistent, and if not, find the likely cause.

A camera is compared with the points that the others triangulate (Hartley & Sturm 1997).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from apf.keypoints.keypoints import Keypoints
from apf.keypoints.landmarks import find_landmarks
from apf.keypoints.timing import AGREEING, describe_lags, find_late_cameras, shift_cameras
from psfs.cameras.camera import CameraRig
from psfs.cameras.triangulation import (
    TriangulationConfig,
    reprojection_errors,
    triangulate,
    undistort_points,
)
from psfs.common.numbers import pick_evenly

#: Examined keypoints, spread over frames and names, and frames in which sides are examined.
_SAMPLED, _FRAMES = 100, 60
#: Share of a camera's keypoints that the others must see somewhere, to be compared.
_KNOWN = 0.2
#: Factors by which the pictures of the keypoints may be larger than the sequence's.
_RESOLUTIONS = (0.25, 1 / 3, 0.5, 2 / 3, 1.5, 2.0, 3.0, 4.0)
#: Fewest frames in which nose or toes are known, and share in which they must lie behind: of nine
#: sequences they lie in front in 95 to 100 %.
_LEAST_FRAMES, _BACKWARD = 5, 0.8
_LIMITS = TriangulationConfig()


def find_disagreements(keypoints: Keypoints, rig: CameraRig, rate: float) -> list[str]:
    """List what is wrong with the cameras' keypoints (px of the original pictures), a line each.

    rate: frames per second. Empty if they are consistent, or too few for a comparison.
    """
    late = find_late_cameras(keypoints, rig)
    if late:
        shifted = shift_cameras(keypoints, late)
        if not _Agreement(shifted, rig).report():
            return describe_lags(late, rate)
    found = _Agreement(keypoints, rig).report()
    if not found and faces_backward(keypoints, rig):
        return [
            "left and right look exchanged in the keypoints of all cameras: nose and toes point "
            "backward; expected the person's own left and right"
        ]
    return found


class _Agreement:
    """A sample of the keypoints, and their distances from each other under a hypothesis."""

    def __init__(self, keypoints: Keypoints, rig: CameraRig) -> None:
        self.rig, self.names = rig, keypoints.names
        points = keypoints.points
        sure = np.nan_to_num(points[..., 2]) >= _LIMITS.min_confidence
        frames, columns = np.nonzero(sure.sum(0) >= min(3, len(rig)))
        chosen = np.linspace(0, len(frames) - 1, min(_SAMPLED, len(frames))).astype(int)
        self.columns = columns[chosen]
        #: All keypoints of the chosen frames (V, N, K, 3), and the chosen ones (V, N, 3).
        self.of_frames = points[:, frames[chosen]].astype(np.float64)
        self.seen = self.of_frames[:, np.arange(len(chosen)), self.columns]
        self.heights = np.array([camera.size[1] for camera in rig], float)

    def report(self) -> list[str]:
        away = np.array([self.measure_distance(self.seen, view) for view in range(len(self.rig))])
        wrong = [int(view) for view in np.flatnonzero(away > 2 * AGREEING)]
        if not wrong:
            return []
        order = [*wrong, *(view for view in range(len(self.rig)) if view not in wrong)]
        for text, seen in self.guess_causes(wrong) if len(self.rig) > 2 else ():
            if all(self.measure_distance(seen, view) <= 2 * AGREEING for view in order):
                return [text]
        if 2 * len(wrong) > len(self.rig):
            pixels = float(np.median(away * self.heights))
            return [
                f"the cameras' keypoints do not fit each other: {pixels:.0f} px apart (median); "
                "expected those of these pictures, and the calibration of these cameras"
            ]
        return [
            f"the keypoints of camera {self.rig.names[view]} lie "
            f"{away[view] * self.heights[view]:.0f} px from where the others see them (median); "
            "expected its own, of the same time, and its calibration"
            for view in wrong
        ]

    def measure_distance(self, seen: np.ndarray, view: int) -> float:
        """Return the median distance of a camera's keypoints from where the others place them.

        seen: (V, N, 3). The distance is a share of the picture's height; 0 if none can be compared,
        1 if the others are inconsistent.
        """
        straight = undistort_points(self.rig, seen)
        others, most = straight.copy(), 1e8
        if len(self.rig) > 2:
            others[view] = np.nan
            most = AGREEING * float(self.heights.min())
        limits = TriangulationConfig(max_error=most, min_confidence=_LIMITS.min_confidence)
        points = triangulate(self.rig, others, limits).points
        errors = reprojection_errors(self.rig, straight, points)[view]
        sure = np.nan_to_num(seen[..., 2]) >= _LIMITS.min_confidence
        sure = sure[view] & (sure.sum(0) >= min(3, len(self.rig)))
        known = sure & ~np.isnan(errors)
        if known.sum() < _KNOWN * sure.sum():
            return 1.0
        return float(np.median(errors[known]) / self.heights[view]) if known.any() else 0.0

    def guess_causes(self, wrong: list[int]) -> Iterator[tuple[str, np.ndarray]]:
        """Yield possible causes, each with the keypoints corrected for it."""
        if len(wrong) == len(self.rig):
            yield from self._guess_for_all()
        for a, b in combinations(wrong, 2):
            seen = self.seen.copy()
            seen[[a, b]] = seen[[b, a]]
            both = f"{self.rig.names[a]} and {self.rig.names[b]}"
            yield f"the keypoints of {both} look exchanged: each one's fit the other's place", seen
        for view in wrong:
            yield from self._guess_for_one(view)

    def _guess_for_all(self) -> Iterator[tuple[str, np.ndarray]]:
        sizes = np.array([camera.size for camera in self.rig], float)[:, None]
        seen = self.seen
        yield "x and y of the keypoints look exchanged", seen[..., [1, 0, 2]]
        upward = seen.copy()
        upward[..., 1] = sizes[..., 1] - 1 - seen[..., 1]
        yield "y of the keypoints seems to go up; expected down, from the picture's top", upward
        for factor in _RESOLUTIONS:
            scaled = seen.copy()
            scaled[..., :2] = (seen[..., :2] + 0.5) / factor - 0.5
            width, height = self.rig[0].size
            yield (
                f"the keypoints look like those of pictures {factor:.3g} times as large; expected "
                f"pixels of {self.rig.names[0]}'s {width} x {height}",
                scaled,
            )

    def _guess_for_one(self, view: int) -> Iterator[tuple[str, np.ndarray]]:
        whose = f"the keypoints of camera {self.rig.names[view]}"
        last = np.array(self.rig[view].size, float) - 1
        mirrored = self.seen.copy()
        mirrored[view, :, 0] = last[0] - mirrored[view, :, 0]
        yield f"{whose} look mirrored, left to right", mirrored
        turned = self.seen.copy()
        turned[view, :, :2] = last - turned[view, :, :2]
        yield f"{whose} look turned by 180 degrees", turned
        other_side = self.seen.copy()
        partners = self._partners()[self.columns]
        other_side[view] = self.of_frames[view, np.arange(len(partners)), partners]
        yield f"left and right look exchanged in {whose}", other_side

    def _partners(self) -> np.ndarray:
        """Return for each name (K,) the column of the same point on the other side, or its own."""
        own = find_landmarks(self.names)
        columns = {landmark.name: column for column, landmark in own.items()}
        partners = np.arange(len(self.names))
        for column, landmark in own.items():
            partners[column] = columns.get(landmark.partner or "", column)
        return partners


def faces_backward(keypoints: Keypoints, rig: CameraRig) -> bool:
    """Return whether the person would look and step backward.

    Forward is perpendicular to the trunk and to the line from the right to the left shoulder, or
    hip. Keypoints whose left and right are exchanged in all cameras fit each other as well as
    before, but the nose lies behind the ears and the toes behind the heels.
    """
    points = _triangulate_landmarks(keypoints, rig)

    def point(name: str) -> np.ndarray:
        unknown = np.full((1, 3), np.nan)
        return points.get(name, unknown)

    def middle(name: str) -> np.ndarray:
        return 0.5 * (point(f"l_{name}") + point(f"r_{name}"))

    up = middle("shoulder") - middle("hip")
    towards = {
        name: np.cross(point(f"l_{name}") - point(f"r_{name}"), up) for name in ("shoulder", "hip")
    }
    votes = [_forward(point("nose") - middle("ear"), towards["shoulder"])]
    for side in ("l", "r"):
        back = f"{side}_heel" if f"{side}_heel" in points else f"{side}_ankle"
        votes.append(_forward(point(f"{side}_big_toe") - point(back), towards["hip"]))
    known = [vote for vote in votes if len(vote) >= _LEAST_FRAMES]
    return bool(known) and all(float(np.mean(vote < 0)) > _BACKWARD for vote in known)


def _triangulate_landmarks(keypoints: Keypoints, rig: CameraRig) -> dict[str, np.ndarray]:
    """Return the points (F, 3) m of some frames by their landmarks' names; NaN where unknown."""
    rows = pick_evenly(keypoints.n_frames, _FRAMES)
    seen = keypoints.undistort(rig).points[:, rows]
    limits = TriangulationConfig(max_error=AGREEING * rig.height)
    landmarks = find_landmarks(keypoints.names)
    places = triangulate(rig, seen[:, :, list(landmarks)], limits).points
    return {landmark.name: places[:, k] for k, landmark in enumerate(landmarks.values())}


def _forward(step: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Return the known ones (n,) of the products of steps (F, 3) and directions (F, 3)."""
    products: np.ndarray = (step * towards).sum(-1)
    return products[np.isfinite(products)]

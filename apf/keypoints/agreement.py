"""Check whether the cameras' keypoints are consistent, and if not, find the likely cause.

A camera is compared with the points that the others triangulate (Hartley & Sturm 1997).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from apf.keypoints.config import AgreementConfig
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.landmarks import find_landmarks
from apf.keypoints.sides import faces_backward
from apf.keypoints.timing import describe_lags, find_late_cameras, shift_cameras
from psfs.cameras.camera import CameraRig
from psfs.cameras.triangulation import (
    TriangulationConfig,
    reprojection_errors,
    triangulate,
    undistort_points,
)


def find_disagreements(
    keypoints: Keypoints, rig: CameraRig, rate: float, config: AgreementConfig | None = None
) -> list[str]:
    """List what is wrong with the cameras' keypoints (px of the original pictures), a line each.

    rate: frames per second. Empty if they are consistent, or too few for a comparison.
    """
    late = find_late_cameras(keypoints, rig)
    if late:
        shifted = shift_cameras(keypoints, late)
        if not _Agreement(shifted, rig, config or AgreementConfig()).report():
            return describe_lags(late, rate)
    found = _Agreement(keypoints, rig, config or AgreementConfig()).report()
    if not found and faces_backward(keypoints, rig):
        return [
            "left and right look exchanged in the keypoints of all cameras: nose and toes point "
            "backward; expected the person's own left and right"
        ]
    return found


class _Agreement:
    """A sample of the keypoints, and their distances from each other under a hypothesis."""

    def __init__(self, keypoints: Keypoints, rig: CameraRig, config: AgreementConfig) -> None:
        self.rig, self.config, self.names = rig, config, keypoints.names
        points = keypoints.points
        sure = np.nan_to_num(points[..., 2]) >= config.confidence
        frames, columns = np.nonzero(sure.sum(0) >= min(3, len(rig)))
        chosen = np.linspace(0, len(frames) - 1, min(config.n_points, len(frames))).astype(int)
        self.columns = columns[chosen]
        #: All keypoints of the chosen frames (V, N, K, 3), and the chosen ones (V, N, 3).
        self.of_frames = points[:, frames[chosen]].astype(np.float64)
        self.seen = self.of_frames[:, np.arange(len(chosen)), self.columns]
        self.heights = np.array([camera.size[1] for camera in rig], float)

    def report(self) -> list[str]:
        away = np.array([self.measure_distance(self.seen, view) for view in range(len(self.rig))])
        wrong = [int(view) for view in np.flatnonzero(away > self.config.away)]
        if not wrong:
            return []
        order = [*wrong, *(view for view in range(len(self.rig)) if view not in wrong)]
        for text, seen in self.guess_causes(wrong) if len(self.rig) > 2 else ():
            if all(self.measure_distance(seen, view) <= self.config.away for view in order):
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
        config = self.config
        straight = undistort_points(self.rig, seen)
        others, most = straight.copy(), 1e8
        if len(self.rig) > 2:
            others[view] = np.nan
            most = 0.5 * config.away * float(self.heights.min())
        limits = TriangulationConfig(max_error=most, min_confidence=config.confidence)
        points = triangulate(self.rig, others, limits).points
        errors = reprojection_errors(self.rig, straight, points)[view]
        sure = np.nan_to_num(seen[..., 2]) >= config.confidence
        sure = sure[view] & (sure.sum(0) >= min(3, len(self.rig)))
        known = sure & ~np.isnan(errors)
        if known.sum() < config.known * sure.sum():
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
        for factor in self.config.resolutions:
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

"""Check whether the cameras' keypoints are consistent, and if not, find the likely cause.

A camera is compared with the points that the others triangulate (Hartley & Sturm 1997).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from apf.keypoints.keypoints import Keypoints
from apf.keypoints.landmarks import find_landmarks
from apf.keypoints.timing import AGREEING, describe_lag, find_late_cameras, shift_cameras
from psfs.cameras.camera import CameraRig
from psfs.cameras.triangulation import (
    TriangulationConfig,
    reprojection_errors,
    triangulate,
    undistort_points,
)
from psfs.common.numbers import pick_evenly

#: Examined keypoints, spread over frames and names.
_SAMPLED = 100
#: Share of a camera's keypoints that the others must see somewhere, to be compared.
_KNOWN = 0.2
#: Fewest frames in which nose or toes are known, and share in which they must lie behind: of nine
#: sequences they lie in front in 95 to 100 %.
_LEAST_FRAMES, _BACKWARD = 5, 0.8
_LIMITS = TriangulationConfig()


def find_disagreements(keypoints: Keypoints, rig: CameraRig, rate: float) -> list[str]:
    """List what is wrong with the cameras' keypoints (px of the original pictures), a line each.

    rate: frames per second. Empty if they are consistent, or too few for a comparison.
    """
    late = find_late_cameras(keypoints, rig)
    if late and not _describe_faults(shift_cameras(keypoints, late), rig):
        return [
            f"the keypoints of camera {name} come about {describe_lag(lag, rate)}; expected those "
            "of the same time"
            for name, lag in late.items()
        ]
    texts = _describe_faults(keypoints, rig)
    if not texts and faces_backward(keypoints, rig):
        return [
            "left and right look exchanged in the keypoints of all cameras: nose and toes point "
            "backward; expected the person's own left and right"
        ]
    return texts


def _describe_faults(keypoints: Keypoints, rig: CameraRig) -> list[str]:
    """Return a line on the cause by which cameras disagree, or one for each camera that does."""
    points = keypoints.points
    sure = np.nan_to_num(points[..., 2]) >= _LIMITS.min_confidence
    frames, columns = np.nonzero(sure.sum(0) >= min(3, len(rig)))
    chosen = pick_evenly(len(frames), _SAMPLED) if len(frames) else np.zeros(0, int)
    frames, columns = frames[chosen], columns[chosen]
    heights = np.array([camera.size[1] for camera in rig], float)

    def measure(points: np.ndarray) -> np.ndarray:
        seen = points[:, np.arange(len(frames)), columns]
        return np.array([_measure_distance(rig, seen, view) for view in range(len(rig))])

    of_frames = points[:, frames].astype(np.float64)
    away = measure(of_frames)
    wrong = np.flatnonzero(away > 2 * AGREEING).tolist()
    if not wrong:
        return []
    causes = _list_causes(of_frames, rig, keypoints.names, wrong) if len(rig) > 2 else ()
    for text, mended in causes:
        if (measure(mended) <= 2 * AGREEING).all():
            return [text]
    if 2 * len(wrong) > len(rig):
        return [
            f"the cameras' keypoints do not fit each other: {np.median(away * heights):.0f} px "
            "apart (median); expected those of these pictures, and the calibration of these cameras"
        ]
    return [
        f"the keypoints of camera {rig.names[view]} lie {away[view] * heights[view]:.0f} px from "
        "where the others see them (median); expected its own, of the same time, and its "
        "calibration"
        for view in wrong
    ]


def _measure_distance(rig: CameraRig, seen: np.ndarray, view: int) -> float:
    """Return the median distance of a camera's keypoints from where the others place them.

    seen: (V, N, 3). The distance is a share of the picture's height; 0 if none can be compared,
    1 if the others are inconsistent.
    """
    straight = undistort_points(rig, seen)
    others, most = straight.copy(), np.inf
    if len(rig) > 2:
        others[view] = np.nan
        most = AGREEING * min(camera.size[1] for camera in rig)
    limits = TriangulationConfig(max_error=min(most, 1e8), min_confidence=_LIMITS.min_confidence)
    points = triangulate(rig, others, limits).points
    errors = reprojection_errors(rig, straight, points)[view]
    sure = np.nan_to_num(seen[..., 2]) >= _LIMITS.min_confidence
    sure = sure[view] & (sure.sum(0) >= min(3, len(rig)))
    known = sure & ~np.isnan(errors)
    if known.sum() < _KNOWN * sure.sum():
        return 1.0
    return float(np.median(errors[known]) / rig[view].size[1]) if known.any() else 0.0


def _list_causes(
    points: np.ndarray, rig: CameraRig, names: Sequence[str], wrong: list[int]
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield possible causes of the disagreement of the cameras that are `wrong`, each with the
    keypoints (V, N, K, 3) corrected for it."""
    last = np.array([camera.size for camera in rig], float)[:, None, None] - 1
    landmarks = find_landmarks(names)
    columns = {landmark.name: column for column, landmark in landmarks.items()}
    partners = np.arange(len(names))
    for column, landmark in landmarks.items():
        partners[column] = columns.get(landmark.partner or "", column)
    turned, mirrored, upward = points.copy(), points.copy(), points.copy()
    turned[..., :2] = last - points[..., :2]
    mirrored[..., 0], upward[..., 1] = turned[..., 0], turned[..., 1]
    if len(wrong) == len(rig):
        yield "x and y of the keypoints look exchanged", points[..., [1, 0, 2]]
        yield "y of the keypoints seems to go up; expected down, from the picture's top", upward
        width, height = rig[0].size
        for factor in sorted({a / b for a in range(1, 5) for b in range(1, 5)} - {1.0}):
            scaled = points.copy()
            scaled[..., :2] = (points[..., :2] + 0.5) / factor - 0.5
            yield (
                f"the keypoints look like those of pictures {factor:.3g} times as large; expected "
                f"pixels of {rig.names[0]}'s {width} x {height}",
                scaled,
            )
    for a, b in combinations(wrong, 2):
        seen = points.copy()
        seen[[a, b]] = seen[[b, a]]
        both = f"{rig.names[a]} and {rig.names[b]}"
        yield f"the keypoints of {both} look exchanged: each one's fit the other's place", seen
    for view in wrong:
        whose = f"the keypoints of camera {rig.names[view]}"
        for text, other in (
            (f"{whose} look mirrored, left to right", mirrored),
            (f"{whose} look turned by 180 degrees", turned),
            (f"left and right look exchanged in {whose}", points[:, :, partners]),
        ):
            seen = points.copy()
            seen[view] = other[view]
            yield text, seen


def faces_backward(keypoints: Keypoints, rig: CameraRig) -> bool:
    """Return whether the person would look and step backward.

    Forward is perpendicular to the trunk and to the line from the right to the left shoulder, or
    hip. Keypoints whose left and right are exchanged in all cameras fit each other as well as
    before, but the nose lies behind the ears and the toes behind the heels.
    """
    rows = pick_evenly(keypoints.n_frames)
    seen = keypoints.undistort(rig).points[:, rows]
    limits = TriangulationConfig(max_error=AGREEING * rig.height)
    landmarks = find_landmarks(keypoints.names)
    positions = triangulate(rig, seen[:, :, list(landmarks)], limits).points
    points = {landmark.name: positions[:, k] for k, landmark in enumerate(landmarks.values())}

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


def _forward(step: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Return the known ones (n,) of the products of steps (F, 3) and directions (F, 3)."""
    products: np.ndarray = (step * towards).sum(-1)
    return products[np.isfinite(products)]

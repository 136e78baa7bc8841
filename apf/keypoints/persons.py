"""Choose one of the persons in the pictures.

In every camera, Viterbi finds the sequence of detections that is confident, large and moves little.
With calibrated cameras, it is then repeated in favour of persons that agree in space with the other
cameras' choices.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from apf.keypoints.config import PersonConfig
from psfs.cameras.camera import CameraRig
from psfs.cameras.triangulation import (
    TriangulationConfig,
    reprojection_errors,
    triangulate,
    undistort_points,
)
from psfs.common.matching import find_best_path


def choose_person(
    points: np.ndarray, rig: CameraRig | None, config: PersonConfig | None = None
) -> np.ndarray:
    """Choose one person from keypoints (V, F, N, K, 3) px of N persons; return (V, F, K, 3)."""
    config = config or PersonConfig()
    if points.shape[2] == 1:
        return points[:, :, 0]
    sizes = person_sizes(points)
    own = _score_persons(points, sizes)
    chosen = np.stack(
        [
            _choose_over_time(view, size, score, config)
            for view, size, score in zip(points, sizes, own, strict=True)
        ]
    )
    if rig is not None and len(rig) > 2:
        straight = undistort_points(rig, points)
        for _ in range(config.rounds):
            before = chosen
            away = _distance_from_others(straight, sizes, before, rig, config)
            scores = own - config.agreement * away
            chosen = np.stack(
                [
                    _choose_over_time(view, size, score, config)
                    for view, size, score in zip(points, sizes, scores, strict=True)
                ]
            )
            if (chosen == before).all():
                break
    return _take_chosen(points, chosen)


def _take_chosen(points: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Return the chosen (V, F) of persons (V, F, N, K, 3)."""
    return np.take_along_axis(points, chosen[:, :, None, None, None], 2)[:, :, 0]


def person_sizes(points: np.ndarray) -> np.ndarray:
    """Return the diagonals (V, F, N) px of the persons' bounding boxes; 1 for missing persons."""
    places = points[..., :2]
    known = np.isfinite(places)
    high = np.where(known, places, -np.inf).max(-2)
    low = np.where(known, places, np.inf).min(-2)
    with np.errstate(invalid="ignore"):
        sizes = np.hypot(*np.moveaxis(high - low, -1, 0))
    return np.where(np.isfinite(sizes), np.maximum(sizes, 1.0), 1.0)


def _score_persons(points: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Score persons (V, F, N) by confidence and size, relative to the best in their camera.

    0 to 1; minus infinity for missing persons.
    """
    sure = np.nan_to_num(points[..., 2]).sum(-1)
    weight = sure * np.sqrt(sizes)
    most = weight.max((1, 2), keepdims=True)
    return np.where(sure > 0, weight / np.maximum(most, 1e-9), -np.inf)


def _choose_over_time(
    points: np.ndarray, sizes: np.ndarray, scores: np.ndarray, config: PersonConfig
) -> np.ndarray:
    """Choose a person (F,) per frame of one camera by Viterbi: best sum of `scores` (F, N) less
    motion.

    Index 0 in frames without persons, which are skipped.
    """
    chosen = np.zeros(len(points), int)
    there = np.flatnonzero(np.isfinite(scores).any(-1))
    if not there.size:
        return chosen
    steps = [
        _person_distances(points[before], points[after], sizes[before], sizes[after])
        for before, after in pairwise(there)
    ]
    changes = config.motion * np.reshape(steps, (-1, points.shape[1], points.shape[1]))
    chosen[there] = find_best_path(-scores[there], changes)
    return chosen


def _person_distances(
    before: np.ndarray, after: np.ndarray, size_before: np.ndarray, size_after: np.ndarray
) -> np.ndarray:
    """Return the distances (N, N) between persons (N, K, 3) of two frames, relative to their size.

    Medians over the keypoints, at most 1; 1 if they have none in common.
    """
    away = np.hypot(*np.moveaxis(before[:, None, :, :2] - after[None, :, :, :2], -1, 0))
    steps = _finite_median(away) / np.sqrt(size_before[:, None] * size_after[None])
    return np.minimum(np.nan_to_num(steps, nan=1.0), 1.0)


def _distance_from_others(
    straight: np.ndarray,
    sizes: np.ndarray,
    chosen: np.ndarray,
    rig: CameraRig,
    config: PersonConfig,
) -> np.ndarray:
    """Measure how far persons (V, F, N) are from where the other cameras' chosen persons are in
    space.

    Relative to their size, at most 1; 0 if the others agree on no point. straight: undistorted
    keypoints (V, F, N, K, 3). chosen: (V, F).
    """
    picked = _take_chosen(straight, chosen)
    size = float(np.median(sizes[sizes > 1])) if (sizes > 1).any() else 1.0
    limits = TriangulationConfig(max_error=config.largest_error * size)
    away = np.zeros(sizes.shape)
    n_frames, n_persons, n_points = straight.shape[1:4]
    for view, camera in enumerate(rig):
        if not np.isfinite(straight[view, :, 1:]).any():
            continue  # there is nobody to choose from
        others = [row for row in range(len(rig)) if row != view]
        rest = CameraRig(tuple(rig[row] for row in others))
        places = triangulate(rest, picked[others], limits).points
        shown = np.broadcast_to(places[:, None], (n_frames, n_persons, n_points, 3)).reshape(-1, 3)
        seen = straight[view].reshape(1, -1, 3)
        off = reprojection_errors(CameraRig((camera,)), seen, shown)[0]
        share = _finite_median(off.reshape(n_frames, n_persons, n_points)) / sizes[view]
        away[view] = np.minimum(np.nan_to_num(share, nan=0.0), 1.0)
    return away


def _finite_median(values: np.ndarray) -> np.ndarray:
    """Return the lower medians of the finite values over the last axis; NaN without any."""
    ordered = np.sort(values, -1)  # NaN last
    count = np.isfinite(values).sum(-1)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[..., None] // 2, -1)[..., 0]
    return np.where(count > 0, middle, np.nan)

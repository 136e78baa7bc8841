"""Lags of all cameras from keypoints alone: two cameras see points of one time along epipolar
lines, which the linear eight-point algorithm finds at the right lag only (Hartley, PAMI 19, 1997).
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from psfs.common.numbers import pick_evenly
from psfs.footage.camera_times import estimate_times, shift_points, sum_costs

#: Rounds of the robust weights of the eight-point algorithm, and their width in medians.
_ROUNDS, _WIDTH = 4, 2.0
#: Least share of the frames that two cameras have in common: a few frames fit at any lag.
_OVERLAP = 0.5
#: Most points of two cameras that are compared at each lag, and distance beyond which they are no
#: farther, in standard deviations.
_COMPARED, _FARTHEST = 600, 10.0


def measure_epipolar(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the distances (N,) of points (N, 2) of two cameras from the epipolar lines of the
    fundamental matrix that fits them best (Sampson's distance), in the points' unit."""
    points, scales = [], []
    for own in (a, b):
        middle, spread = own.mean(axis=0), own.std() + 1e-12
        points.append(np.column_stack([(own - middle) / spread, np.ones(len(own))]))
        scales.append(spread)
    rows = (points[1][:, :, None] * points[0][:, None]).reshape(-1, 9)
    weights, away = np.ones(len(rows)), np.zeros(len(rows))
    for _ in range(_ROUNDS):
        normal = (rows * weights[:, None] ** 2).T @ rows
        U, sizes, Vt = np.linalg.svd(np.linalg.eigh(normal)[1][:, 0].reshape(3, 3))
        F = U @ np.diag([sizes[0], sizes[1], 0]) @ Vt
        lines, back = points[0] @ F.T, points[1] @ F
        slope = (lines[:, :2] ** 2).sum(1) / scales[1] ** 2 + (back[:, :2] ** 2).sum(1) / scales[
            0
        ] ** 2
        slope = np.sqrt(slope) + 1e-15
        away = np.abs((points[1] * lines).sum(axis=1)) / slope
        weights = 1 / slope / (1 + (away / (_WIDTH * np.median(away) + 1e-12)) ** 2)
    return away


def estimate_lags(seen: np.ndarray, most: int, fewest: int, noise: float) -> np.ndarray:
    """Return the lags (V,) of cameras behind the first, whole frames up to `most`.

    seen: (V, F, K, 2), NaN where a point is not seen. fewest: points that two cameras must share to
    be compared. noise: standard deviation of a point, px.
    """
    pairs = combinations(range(len(seen)), 2)
    costs = {(a, b): _compare_lags(seen[a], seen[b], most, fewest, noise) for a, b in pairs}
    whole = np.array(estimate_times(len(seen), costs).whole)
    return whole - whole[0]


def _compare_lags(a: np.ndarray, b: np.ndarray, most: int, fewest: int, noise: float) -> np.ndarray:
    """Return the costs, see `camera_times`, of the distances from epipolar lines at all lags."""
    n_frames, n_points = a.shape[:2]
    distances = np.full((n_points, 2 * most + 1, n_frames), np.nan)
    for row, lag in enumerate(range(-most, most + 1)):
        other = shift_points(b, lag)
        rows = np.flatnonzero((np.isfinite(a) & np.isfinite(other)).all(-1))
        rows = rows[pick_evenly(len(rows), _COMPARED)]
        if len(rows) >= fewest and n_frames - abs(lag) >= _OVERLAP * n_frames:
            away = measure_epipolar(a.reshape(-1, 2)[rows], other.reshape(-1, 2)[rows])
            distances[rows % n_points, row, rows // n_points] = away
    # Two cameras may be `most` apart, on either side of the median camera.
    return np.pad(sum_costs(distances, _FARTHEST * noise), ((most, most), (0, 0), (0, 0)))

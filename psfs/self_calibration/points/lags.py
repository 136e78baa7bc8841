"""Lags of all cameras from keypoints alone: two cameras see points of one time along epipolar
lines, which the linear eight-point algorithm finds at the right lag only (Hartley, PAMI 19, 1997).
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from psfs.common.numbers import pick_evenly

#: Rounds of the robust weights of the eight-point algorithm, and their width in medians.
_ROUNDS, _WIDTH = 4, 2.0
#: Least share of the frames that two cameras have in common: a few frames fit at any lag.
_OVERLAP = 0.5
#: Most points of two cameras that are compared at each lag.
_COMPARED = 600


def shift_points(points: np.ndarray, lag: int) -> np.ndarray:
    """Return points (F, ...) of which frame t is the given frame t + lag; NaN where none is."""
    out = np.full_like(points, np.nan)
    begin, end = max(0, -lag), len(points) - max(0, lag)
    if begin < end:
        out[begin:end] = points[begin + lag : end + lag]
    return out


def measure_epipolar(a: np.ndarray, b: np.ndarray) -> float:
    """Return the median distance of points (N, 2) of two cameras from the epipolar lines of the
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
    return float(np.median(away))


def compare_lags(seen: np.ndarray, most: int, fewest: int) -> dict[tuple[int, int], np.ndarray]:
    """Return, for each pair of cameras, the median distances (2 most + 1,) from epipolar lines at
    every lag of the second camera; NaN where they share fewer than `fewest` points.

    seen: (V, F, K, 2), NaN where a point is not seen.
    """
    tables = {}
    for a, b in combinations(range(len(seen)), 2):
        costs = np.full(2 * most + 1, np.nan)
        for row, lag in enumerate(range(-most, most + 1)):
            other = shift_points(seen[b], lag)
            both = np.isfinite(seen[a]).all(-1) & np.isfinite(other).all(-1)
            rows = np.flatnonzero(both)
            rows = rows[pick_evenly(len(rows), _COMPARED)]
            if len(rows) >= fewest and seen.shape[1] - abs(lag) >= _OVERLAP * seen.shape[1]:
                costs[row] = measure_epipolar(
                    seen[a].reshape(-1, 2)[rows], other.reshape(-1, 2)[rows]
                )
        tables[a, b] = costs
    return tables


def choose_lags(tables: dict[tuple[int, int], np.ndarray], n_cameras: int, most: int) -> np.ndarray:
    """Return the lags (V,) of the cameras, the first 0, with the least sum of the pairs' costs.

    From the lags to each camera in turn, one camera after another is moved while that lessens the
    sum.
    """
    tables = {pair: _logarithm(costs) for pair, costs in tables.items()}
    best: tuple[float, np.ndarray] = np.inf, np.zeros(n_cameras, int)
    for root in range(n_cameras):
        lags = np.zeros(n_cameras, int)
        for view in range(n_cameras):
            if view != root:
                own = tables[min(root, view), max(root, view)]
                lags[view] = (int(own.argmin()) - most) * (1 if root < view else -1)
        cost = np.inf
        while (total := _descend(tables, lags, most)) < cost:
            cost = total
        if cost < best[0]:
            best = cost, lags
    return best[1] - best[1][0]


def _logarithm(costs: np.ndarray) -> np.ndarray:
    """Return the logarithms of costs, the worst where they are unknown."""
    worst = np.nanmax(costs) if np.isfinite(costs).any() else 1.0
    return np.log(np.where(np.isfinite(costs), costs, worst) + 1e-9)


def _descend(tables: dict[tuple[int, int], np.ndarray], lags: np.ndarray, most: int) -> float:
    """Move each camera to its best lag, the others held; return the sum of costs."""
    span = np.arange(-most, most + 1)
    for view in range(len(lags)):
        total = np.zeros(len(span))
        for (a, b), costs in tables.items():
            if view in (a, b):
                apart = span - lags[a] if view == b else lags[b] - span
                total += costs[np.clip(apart + most, 0, 2 * most)]
        lags[view] = span[int(total.argmin())]
    return float(
        sum(c[int(np.clip(lags[b] - lags[a] + most, 0, 2 * most))] for (a, b), c in tables.items())
    )

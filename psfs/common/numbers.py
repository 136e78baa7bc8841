"""Even samples and runs of a series, assignments, paths of states, units, and numbers for JSON."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import ArrayLike

#: Metres per unit of length.
METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
#: An inch, m.
INCH = 0.0254
#: Rotation that takes Y up to Z up, the x axis staying: (x, y, z) becomes (x, -z, y).
FROM_Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
#: Probability of each test that sound footage, or a sound camera, is accused.
FALSE_ALARMS = 1e-3
#: Number of frames that stand for a take: enough for a median.
SAMPLES = 25
#: Time of a step, s: errors of silhouettes and limbs are independent after it, and whoever is seen
#: for a shorter time is not counted.
STEP_SECONDS = 0.5


def drop_origin(points: np.ndarray) -> np.ndarray:
    """Return points (..., 3) with NaN for those at exactly 0 0 0, as which many programs of motion
    capture write missing ones."""
    return np.where((points == 0).all(-1, keepdims=True), np.nan, points)


def pick_evenly(n: int, most: int = SAMPLES) -> np.ndarray:
    """Return at most `most` of n indices, evenly spaced from the first to the last."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int))


def select_span(frames: np.ndarray | range, step: int) -> slice:
    """Return the slice that selects, in steps of `step`, from the first to the last of some frames
    (F,), or back from the last to the first."""
    low, high = int(min(frames)), int(max(frames))
    return slice(low, high + 1, step) if step > 0 else slice(high, low - 1 if low else None, step)


def find_true_runs(mask: np.ndarray) -> list[slice]:
    """Return the maximal runs of frames in which `mask` (F,) is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [slice(begin, end) for begin, end in edges.reshape(-1, 2)]


def smooth_locally(values: np.ndarray, window: int) -> np.ndarray:
    """Return values (F, ...) smoothed by parabolas over an odd `window` of frames (Savitzky & Golay
    1964); those of the first and last windows reach to the ends.

    As `scipy.signal.savgol_filter`, which takes a second to import."""
    powers = np.vander(np.arange(window) - window // 2, 3)
    weights = powers @ np.linalg.pinv(powers)  # of the window's values in the polynomial's
    half = window // 2
    windows = np.lib.stride_tricks.sliding_window_view(values, window, axis=0)
    begin = np.tensordot(weights[:half], values[:window], 1)
    end = np.tensordot(weights[half + 1 :], values[-window:], 1)
    return np.concatenate([begin, windows @ weights[half], end])


def mean_known(values: ArrayLike, nothing: float = np.nan) -> float:
    """Return the mean of the finite values; `nothing` without any."""
    known = np.asarray(values)[np.isfinite(values)]
    return float(known.mean()) if known.size else nothing


def known_means(values: np.ndarray, axis: int = 0) -> np.ndarray:
    """Return the means of the finite values along an axis; NaN where there are none."""
    return np.ma.filled(np.ma.masked_invalid(values).mean(axis), np.nan)


def jackknife(totals: np.ndarray, estimate: Callable[[np.ndarray], float]) -> np.ndarray:
    """Return the pseudo-values (N,) of an estimate from sums of rows (N, K) of samples: their mean
    is the estimate without its bias, their spread tells its deviation (Tukey 1958)."""
    count, every = len(totals), totals.sum(axis=0)
    rest = every - totals if count > 1 else totals
    parts = np.array([estimate(row) for row in rest])
    return np.asarray(count * estimate(every) - (count - 1) * parts)


def json_number(value: float, digits: int = 5) -> float | None:
    """Round a number for JSON; None for NaN, infinity and masked values, which JSON lacks."""
    return round(float(value), digits) if np.isfinite(value) else None


def match_pairs(costs: np.ndarray, limit: float = np.inf) -> list[tuple[int, int]]:
    """Return the pairs (row, column) of least total cost (Hungarian method), each in one pair at
    most, of those with a cost below `limit`.

    costs: (N, M); infinite or NaN where two cannot be a pair.
    """
    if not costs.size:
        return []
    possible = np.isfinite(costs) & (costs < limit)
    impossible = 1 + np.abs(costs[possible]).sum()  # more than all others together
    chosen = scipy.optimize.linear_sum_assignment(np.where(possible, costs, impossible))
    pairs = zip(*chosen, strict=True)
    return [(int(row), int(column)) for row, column in pairs if possible[row, column]]


def find_best_path(costs: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Return the sequence of states (F,) of least total cost (Viterbi 1967).

    costs: (F, K) of each state; infinite where it cannot be. changes: (F - 1, K, K) of the
    transition from one state to another.
    """
    n_frames, total = len(costs), costs[0].copy()
    come_from = np.zeros(costs.shape, int)
    for frame in range(1, n_frames):
        reached = total[:, None] + changes[frame - 1]
        come_from[frame] = reached.argmin(0)
        total = reached.min(0) + costs[frame]
    path = np.empty(n_frames, int)
    path[-1] = total.argmin()
    for frame in range(n_frames - 1, 0, -1):
        path[frame - 1] = come_from[frame, path[frame]]
    return path

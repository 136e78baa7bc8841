"""The head's ups and downs, which all cameras see alike: lags without any geometry between
cameras."""

from __future__ import annotations

import numpy as np

from psfs.common.numbers import smooth_locally
from psfs.diagnostics.hulls import HullRays
from psfs.diagnostics.tangency import NOISE
from psfs.self_calibration.pairing import differing_shares
from psfs.self_calibration.upright import UprightView, measure_elevations

#: Window that separates the head's steps from slower motion, s.
_WINDOW = 1.0
#: Deviation from the smoothed apparent height, as a share, beyond which a frame is not used.
_OUTLIER = 0.15


def measure_head_height(hulls: HullRays, view: UprightView, rate: float) -> np.ndarray:
    """Return the height (F,) of the topmost point relative to its mean over a window, statures; NaN
    where the person is not wholly seen. rate: frames per second."""
    top, bottom = measure_elevations(hulls, view.axes)
    size = np.tan(top) - np.tan(bottom)
    size[~(size > 1e-3)] = np.nan
    window = 2 * max(2, round(0.5 * _WINDOW * rate)) + 1
    smooth = _smooth(size, window, 2)
    with np.errstate(invalid="ignore"):
        top = np.where(np.abs(size / smooth - 1) < _OUTLIER, top, np.nan)
    smooth = _smooth(np.where(np.isfinite(top), size, np.nan), window, 2)
    height: np.ndarray = np.tan(top) / smooth
    return height - _smooth(height, window, 1)


def compare_head_heights(a: np.ndarray, b: np.ndarray, most: int, step: int) -> np.ndarray:
    """Return the costs (2 most + 1,) of lags in steps of `step` frames, each the least of those
    around it."""
    reach = most * step + step // 2
    lags = np.arange(-reach, reach + 1)
    one, other = a[:, None], b[:, None]
    costs = np.concatenate(
        [differing_shares(one, other, lags[k : k + 1], NOISE) for k in range(len(lags))]
    )
    costs = np.where(np.isfinite(costs), costs, 1.0)
    around = np.lib.stride_tricks.sliding_window_view(costs, 2 * (step // 2) + 1)
    return around[::step].min(axis=1)


def _smooth(values: np.ndarray, window: int, degree: int) -> np.ndarray:
    """Return values (F,) smoothed by a Savitzky-Golay filter, with gaps filled linearly."""
    known, times = np.isfinite(values), np.arange(len(values))
    if known.sum() < 5:
        return values
    filled = np.interp(times, times[known], values[known])
    window = min(window, 2 * ((len(values) - 1) // 2) + 1)
    return smooth_locally(filled, window, min(degree, window - 1))

"""The head's ups and downs, which all cameras see alike: lags without any geometry between
cameras."""

from __future__ import annotations

import numpy as np
from scipy.signal import savgol_filter

from psfs.self_calibration.config import PairConfig
from psfs.self_calibration.hulls import HullRays
from psfs.self_calibration.pairing import differing_shares
from psfs.self_calibration.upright import UprightView, measure_elevations


def measure_bobbing(
    hulls: HullRays, view: UprightView, rate: float, config: PairConfig
) -> np.ndarray:
    """Return the height (F,) of the topmost point relative to its mean over a window, statures; NaN
    where the person is not wholly seen. rate: frames per second."""
    top, bottom = measure_elevations(hulls, view.axes)
    size = np.tan(top) - np.tan(bottom)
    size[~(size > 1e-3)] = np.nan
    window = 2 * max(2, round(0.5 * config.window * rate)) + 1
    smooth = _smooth(size, window, 2)
    with np.errstate(invalid="ignore"):
        top = np.where(np.abs(size / smooth - 1) < config.outlier, top, np.nan)
    smooth = _smooth(np.where(np.isfinite(top), size, np.nan), window, 2)
    height: np.ndarray = np.tan(top) / smooth
    return height - _smooth(height, window, 1)


def compare_bobbing(
    a: np.ndarray, b: np.ndarray, most: int, step: int, config: PairConfig
) -> np.ndarray:
    """Return the costs (2 most + 1,) of lags in steps of `step` frames, each the least of those
    around it."""
    reach = most * step + step // 2
    lags = np.arange(-reach, reach + 1)
    one, other = a[:, None], b[:, None]
    costs = np.concatenate(
        [
            differing_shares(one, other, lags[k : k + 1], config.bobbing, config.fewest)
            for k in range(len(lags))
        ]
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
    return savgol_filter(filled, window, min(degree, window - 1))

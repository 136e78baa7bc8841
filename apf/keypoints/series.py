"""Fill gaps in points over time, and smooth them."""

from __future__ import annotations

import numpy as np

from cl import InputError
from psfs.common.numbers import find_true_runs

#: Order of the filter; running forwards and backwards doubles it.
_ORDER = 2


def fill_gaps(points: np.ndarray, longest: int | None = None) -> np.ndarray:
    """Fill gaps (NaN) of points (F, K, 3) by linear interpolation, at the ends with the nearest
    point.

    longest: longest gap to fill, frames; None: all. Points that are never known stay NaN.
    """
    filled, frames = points.copy(), np.arange(len(points))
    for k in range(points.shape[1]):
        known = np.all(np.isfinite(points[:, k]), axis=-1)
        for gap in find_true_runs(~known) if known.any() else ():
            if longest is None or gap.stop - gap.start <= longest:
                axes = [np.interp(frames[gap], frames[known], axis) for axis in points[known, k].T]
                filled[gap, k] = np.stack(axes, -1)
    return filled


def low_pass(points: np.ndarray, rate: float, cutoff: float) -> np.ndarray:
    """Smooth points (F, K, 3) at `rate` per second with a low-pass filter at `cutoff` Hz.

    A Butterworth filter of order 2, forwards and backwards (order 4 in effect, no delay; half of
    the amplitude is left at the cut-off). Stretches between gaps are filtered separately; those too
    short for the filter are unchanged. Raises InputError.
    """
    if not 0 < cutoff < rate / 2:
        raise InputError(
            f"the low-pass is at {cutoff:g} Hz; expected between 0 and {rate / 2:g}, half of the "
            "frame rate"
        )
    from scipy.signal import butter, sosfiltfilt  # takes a while to load

    sections = butter(_ORDER, cutoff, fs=rate, output="sos")
    shortest = 3 * (2 * len(sections) + 1)  # SciPy's own padding
    out = points.copy()
    for k in range(points.shape[1]):
        for run in find_true_runs(np.all(np.isfinite(points[:, k]), axis=-1)):
            piece = points[run, k]
            if len(piece) > shortest:
                # Padded by all of itself: the filter has settled then.
                out[run, k] = sosfiltfilt(sections, piece, axis=0, padlen=len(piece) - 1)
    return out

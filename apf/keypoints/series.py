"""Points over time: gaps closed, noise taken away."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, sosfiltfilt

from cl import InputError

#: Poles of the filter, which runs forwards and backwards: twice as many in effect.
_ORDER = 2
#: Periods of the cut-off that a stretch is continued by, so that the filter has settled.
_PAD = 2.0


def without_gaps(points: np.ndarray, longest: int | None = None) -> np.ndarray:
    """Return points (F, K, 3) whose gaps (NaN) of at most `longest` frames, or all, are filled: on
    straight lines, at the ends with the nearest known point. One that is never known stays so."""
    filled = points.copy()
    frames = np.arange(len(points))
    for k in range(points.shape[1]):
        known = np.flatnonzero(np.isfinite(points[:, k]).all(-1))
        if not known.size:
            continue
        gap = np.ones(len(points), bool)
        gap[known] = False
        if longest is not None:
            bounds = np.concatenate([[-1], known, [len(points)]])
            after = np.searchsorted(bounds, frames, side="right")
            gap &= bounds[np.minimum(after, len(bounds) - 1)] - bounds[after - 1] - 1 <= longest
        for axis in range(3):
            filled[gap, k, axis] = np.interp(frames[gap], known, points[known, k, axis])
    return filled


def low_passed(points: np.ndarray, rate: float, cutoff: float) -> np.ndarray:
    """Return points (F, K, 3) at `rate` per second without what moves faster than `cutoff` Hz.

    A Butterworth filter of order 2, forwards and backwards (order 4 in effect, no delay; at the
    cut-off half of the amplitude is left). Stretches between gaps are filtered each by itself;
    those too short for it stay as they are. Raises InputError.
    """
    if not 0 < cutoff < rate / 2:
        raise InputError(
            f"the low-pass is at {cutoff:g} Hz; expected between 0 and {rate / 2:g}, half of the "
            "frame rate"
        )
    sections = butter(_ORDER, cutoff, fs=rate, output="sos")
    shortest = 3 * (2 * len(sections) + 1)  # SciPy's own padding
    pad = max(shortest, round(_PAD * rate / cutoff))
    out = points.copy()
    for k in range(points.shape[1]):
        known = np.isfinite(points[:, k]).all(-1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]])))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            if stop - start > shortest:
                piece = points[start:stop, k]
                padding = min(pad, len(piece) - 1)
                out[start:stop, k] = sosfiltfilt(sections, piece, axis=0, padlen=padding)
    return out

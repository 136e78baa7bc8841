"""Even samples of a series, and numbers for JSON."""

from __future__ import annotations

import numpy as np


def pick_evenly(n: int, most: int) -> np.ndarray:
    """Return at most `most` of n indices, evenly spaced from the first to the last."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int))


def json_number(value: float, digits: int = 5) -> float | None:
    """Round a number for JSON; None for NaN, infinity and masked values, which JSON lacks."""
    return round(float(value), digits) if np.isfinite(value) else None

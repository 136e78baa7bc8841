"""Reconstruction of whole pictures from a stored crop."""

from __future__ import annotations

import numpy as np


def uncrop(part: np.ndarray, corner: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
    """Return the picture (H, W, ..) of `shape` = (H, W) whose crop `part` (h, w, ..) begins at
    `corner`, row and column; repeat the crop's border outside."""
    rows, columns = (
        np.clip(np.arange(size) - first, 0, kept - 1)
        for size, first, kept in zip(shape, corner, part.shape[:2], strict=True)
    )
    return part[rows[:, None], columns]

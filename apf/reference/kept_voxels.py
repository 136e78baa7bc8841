"""What becomes of pictures of which one part was kept."""

from __future__ import annotations

import numpy as np


def uncropped(part: np.ndarray, corner: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
    """Return the picture (H, W, ..) of `shape` = (H, W) whose part (h, w, ..) from `corner`, row
    and column, on was kept; beside it, it goes on as at the part's rim."""
    rows, columns = (
        np.clip(np.arange(size) - first, 0, kept - 1)
        for size, first, kept in zip(shape, corner, part.shape[:2], strict=True)
    )
    whole: np.ndarray = part[rows[:, None], columns]
    return whole

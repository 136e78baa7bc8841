"""Proximity by the exact distance to the nearest edge. Twin of common/distance.h."""

from __future__ import annotations

import numpy as np
import scipy


def proximity(edges: np.ndarray, table: np.ndarray, metric: str = "euclidean") -> np.ndarray:
    """Return (h, w) uint8: the entry of `table` (reach^2 + 2,) at the squared distance, px^2, to
    the nearest of `edges` (h, w) bool; the last entry beyond reach. metric: "euclidean", or
    "chessboard" for the greater of |dx| and |dy|."""
    if not edges.any():
        return np.full(edges.shape, table[-1])
    if metric == "chessboard":
        squared = scipy.ndimage.distance_transform_cdt(~edges, "chessboard").astype(int) ** 2
    else:
        squared = np.rint(scipy.ndimage.distance_transform_edt(~edges) ** 2).astype(int)
    return table[np.minimum(squared, len(table) - 1)]

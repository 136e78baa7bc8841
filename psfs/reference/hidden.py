"""Pixels where furniture hides what is behind it. Twin of psfs/silhouettes/hidden.py, hidden.cl."""

from __future__ import annotations

import numpy as np

from psfs.silhouettes.hidden import UNKNOWN


def hide(evidence: np.ndarray, hidden: np.ndarray | None) -> np.ndarray:
    """Return evidence (V, H, W) int8, `UNKNOWN` at hidden pixels (V, H, W) where it is not above
    0."""
    if hidden is None:
        return evidence
    return np.where(hidden & (evidence <= 0), np.int8(UNKNOWN), evidence)


def mark_hidden(maps: np.ndarray, evidence: np.ndarray) -> None:
    """Flip the lowest bit of the silhouettes, the first channel of maps (V, H, W, 2) uint8, where
    the evidence (V, H, W) int8 is `UNKNOWN`."""
    maps[..., 0] ^= (evidence == UNKNOWN).view(np.uint8)

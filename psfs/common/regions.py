"""Regions of pixels or voxels: overlap and connected components."""

from __future__ import annotations

import numpy as np
import scipy


def iou(a: np.ndarray, b: np.ndarray) -> float:
    """Return the intersection over union of two bool arrays of one shape; NaN if both are empty."""
    union = (a | b).sum()
    return float((a & b).sum() / union) if union else float("nan")


def keep_large_regions(occupied: np.ndarray, share: float) -> np.ndarray:
    """Return `occupied` (any shape, bool) without small connected regions.

    Regions are connected by edges and corners. One is kept if it has at least `share` of the
    largest region's elements.
    """
    labels, _ = _label_regions(occupied)
    sizes = np.bincount(labels.ravel(), minlength=1)
    sizes[0] = 0  # the background
    kept = sizes >= np.maximum(1, share * sizes.max())
    return kept[labels]


def find_connected_regions(occupied: np.ndarray) -> list[np.ndarray]:
    """Return the flat indices, ascending, of each connected region, the largest first."""
    labels = _label_regions(occupied)[0].ravel()
    within = np.flatnonzero(labels)
    within = within[np.argsort(labels[within], kind="stable")]
    parts = np.split(within, np.flatnonzero(np.diff(labels[within])) + 1)
    return sorted((part for part in parts if len(part)), key=len, reverse=True)


def find_largest_region_box(occupied: np.ndarray) -> np.ndarray | None:
    """Return the first and last + 1 index (2, n) of the largest region; None if all is empty."""
    labels, count = _label_regions(occupied)
    if not count:
        return None
    largest = int(np.bincount(labels.ravel())[1:].argmax())
    part = scipy.ndimage.find_objects(labels)[largest]
    return np.array([[s.start for s in part], [s.stop for s in part]])


def bounding_box(region: np.ndarray) -> tuple[slice, slice] | None:
    """Return the rows and columns that hold all of `region` (H, W) bool; None if it is empty."""
    rows, columns = (np.flatnonzero(region.any(axis)) for axis in (1, 0))
    if not rows.size:
        return None
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _label_regions(occupied: np.ndarray) -> tuple[np.ndarray, int]:
    labels, count = scipy.ndimage.label(occupied, np.ones((3,) * occupied.ndim))
    return np.asarray(labels), int(count)

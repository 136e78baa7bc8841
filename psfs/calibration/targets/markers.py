"""Detect the bright markers of a wand in pictures."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from psfs.calibration.targets.boards import Found, to_grey
from psfs.calibration.targets.target import EQUAL, Target

#: Least difference between a marker and the scene without it, grey levels.
_BRIGHTER = 40
#: Least share of the brightest difference that a marker's pixels reach, and that above which pixels
#: around a marker count to its centre.
_SHARE, _RIM = 0.5, 0.15
#: Fewest pixels of a marker, and largest share of the picture.
_SMALLEST, _LARGEST = 2, 0.02
#: Largest deviation of three markers from a line, as a share of the wand's length.
_OFF_LINE = 0.06


class MarkerFinder:
    """Detector of the markers of a wand, which must be the only bright spots that move.

    scenes: (h, w) uint8 grey levels of every view without the wand, such as medians of pictures.
    """

    def __init__(self, target: Target, scenes: Sequence[np.ndarray]) -> None:
        self.target, self._scenes = target, scenes

    def __call__(self, view: int, picture: np.ndarray) -> Found | None:
        """Return ids (N,) and pixels (N, 2) of the wand's points.

        None if they are not seen, or if more bright spots move.
        """
        difference = cv2.subtract(to_grey(picture), self._scenes[view])
        spots = find_bright_spots(difference)
        count = len(self.target.points)
        if len(spots) != count:
            return None
        if count == 3:
            ordered = self._sort_along_wand(spots)
            return None if ordered is None else (np.arange(3), ordered)
        return np.arange(count), spots

    def _sort_along_wand(self, spots: np.ndarray) -> np.ndarray | None:
        """Sort three spots (3, 2) in the order of the wand's markers.

        None if they do not lie on a line, or if their distances do not distinguish the ends.
        """
        middle = spots.mean(axis=0)
        _, sizes, axes = np.linalg.svd(spots - middle)
        if sizes[1] > _OFF_LINE * sizes[0] + 1.0:
            return None
        spots = spots[np.argsort((spots - middle) @ axes[0])]
        if len(self.target.orders) > 1:
            return spots
        near, far = np.linalg.norm(np.diff(spots, axis=0), axis=1)
        first, second = np.diff(self.target.points[:, 0])
        if max(near, far) < EQUAL * min(near, far):
            return None
        return spots if (near < far) == (first < second) else spots[::-1]


def find_bright_spots(difference: np.ndarray) -> np.ndarray:
    """Return the centres (N, 2) px of bright spots in (h, w) uint8, weighted by brightness."""
    brightest = int(difference.max())
    if brightest < _BRIGHTER:
        return np.zeros((0, 2))
    mask = (difference > max(_BRIGHTER / 2, _SHARE * brightest)).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    spots = []
    for label in range(1, count):
        x, y, width, height, area = stats[label]
        if not _SMALLEST <= area <= _LARGEST * mask.size:
            continue
        # The spot's dimmer rim counts, too: the weight is what exceeds the threshold around it.
        bottom, right = min(y + height + 2, mask.shape[0]), min(x + width + 2, mask.shape[1])
        box = np.s_[max(0, y - 2) : bottom, max(0, x - 2) : right]
        others = (labels[box] != label) & (labels[box] > 0)
        weights = np.where(others, 0, difference[box]).astype(np.float64)
        weights = np.maximum(weights - _RIM * brightest, 0)
        rows, columns = np.mgrid[box]
        spots.append(
            [(columns * weights).sum() / weights.sum(), (rows * weights).sum() / weights.sum()]
        )
    return np.array(spots).reshape(-1, 2)

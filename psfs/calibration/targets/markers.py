"""Finding the bright markers of a wand in pictures."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from psfs.calibration.targets.boards import Found, grey_of
from psfs.calibration.targets.target import Target

#: Grey levels by which a marker is brighter than the scene behind it, at least, and the share of
#: the brightest difference that its pixels have.
_BRIGHTER, _SHARE = 40, 0.5
#: Pixels of a marker, at least; of the picture's, at most.
_SMALLEST, _LARGEST = 2, 0.02
#: Share of a wand's length by which three markers may lie off their line.
_OFF_LINE = 0.06
#: Share by which the halves of an uneven wand must differ in a picture to tell its ends.
_TELLS = 1.1


class MarkerFinder:
    """Finds the markers of a wand: the only bright spots that move.

    scenes: (h, w) uint8 grey levels of every view behind the wand, such as medians of pictures.
    """

    def __init__(self, target: Target, scenes: Sequence[np.ndarray]) -> None:
        self.target = target
        self._scenes = scenes

    def __call__(self, view: int, picture: np.ndarray) -> Found | None:
        """Return ids (N,) and pixels (N, 2) of the wand's points; None where they are not seen, or
        more bright spots move."""
        spots = bright_spots(cv2.subtract(grey_of(picture), self._scenes[view]))
        count = len(self.target.points)
        if len(spots) != count:
            return None
        if count == 3:
            ordered = self._along(spots)
            return None if ordered is None else (np.arange(3), ordered)
        return np.arange(count), spots

    def _along(self, spots: np.ndarray) -> np.ndarray | None:
        """Return three spots (3, 2) in the order of the wand's markers, None where they do not lie
        on a line, or their distances do not tell the ends."""
        middle = spots.mean(axis=0)
        _, sizes, axes = np.linalg.svd(spots - middle)
        if sizes[1] > _OFF_LINE * sizes[0] + 1.0:
            return None
        spots = spots[np.argsort((spots - middle) @ axes[0])]
        if len(self.target.orders) > 1:
            return spots
        near, far = np.linalg.norm(np.diff(spots, axis=0), axis=1)
        first, second = np.diff(self.target.points[:, 0])
        if max(near, far) < _TELLS * min(near, far):
            return None
        return spots if (near < far) == (first < second) else spots[::-1]


def bright_spots(difference: np.ndarray) -> np.ndarray:
    """Return the centres (N, 2) px of what is brighter, weighted by how much (h, w) uint8."""
    brightest = int(difference.max())
    if brightest < _BRIGHTER:
        return np.zeros((0, 2))
    mask = (difference > max(_BRIGHTER / 2, _SHARE * brightest)).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    found = []
    for label in range(1, count):
        x, y, width, height, area = stats[label]
        if not _SMALLEST <= area <= _LARGEST * mask.size:
            continue
        # The spot's dimmer rim counts, too: weights are what is above the threshold around it.
        box = np.s_[max(0, y - 2) : y + height + 2, max(0, x - 2) : x + width + 2]
        others = (labels[box] != label) & (labels[box] > 0)
        weights = np.where(others, 0, difference[box]).astype(np.float64)
        weights = np.maximum(weights - 0.15 * brightest, 0)
        rows, columns = np.mgrid[box]
        found.append(
            [(columns * weights).sum() / weights.sum(), (rows * weights).sum() / weights.sum()]
        )
    return np.array(found).reshape(-1, 2)

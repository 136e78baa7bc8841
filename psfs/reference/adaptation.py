"""The NumPy twin of `psfs.background.adaptation.Adaptation`."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from psfs.background.adaptation import ENOUGH, NEAREST, PERIOD, rates
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.cameras.cells import CELL
from psfs.config import SilhouetteConfig
from psfs.reference.silhouette import _of_pixels, in_pictures
from psfs.silhouettes.appearance import REACH


class NumpyAdaptation:
    """Same results; `background` is what drifts, a copy of the one given, in float64."""

    def __init__(self, rig: CameraRig, background: Background, config: SilhouetteConfig) -> None:
        self.config = config
        std = np.maximum(background.std, config.sigma_floor).astype(np.float64)
        self.background = Background(background.mean.astype(np.float64), std)
        self._inside = in_pictures(rig)
        self._frames = 0
        self._drift = np.zeros(len(rig))

    def __call__(self, images: np.ndarray, evidence: np.ndarray, marks: np.ndarray) -> None:
        """images (V, H, W, 3) uint8, evidence counts (V, H, W), marks (V, rows, columns) bool."""
        due = np.arange(marks.shape[1]) % PERIOD == self._frames % PERIOD
        self._frames += 1
        mean_rate, variance_rate = rates(self.config)
        for view, image in enumerate(images):
            mean, std = self.background.mean[view], self.background.std[view]
            free = _of_pixels(~_person(marks[view], evidence[view]), image.shape)
            difference, looked_at = image - mean, self._inside[view].copy()
            looked_at &= _of_pixels(np.broadcast_to(due[:, None], marks[view].shape), image.shape)
            pixels = looked_at & free & (((difference / std) ** 2).sum(-1) <= NEAREST)
            mean[looked_at & ~pixels] *= 1 + self._drift[view]
            d, variance, seen = difference[pixels], std[pixels] ** 2, mean[pixels].sum()
            self._drift[view] = mean_rate * d.sum() / seen if seen >= ENOUGH else 0
            mean[pixels] += mean_rate * d
            variance += variance_rate * (d**2 - variance)
            std[pixels] = np.maximum(np.sqrt(variance), self.config.sigma_floor)


def _person(marks: np.ndarray, evidence: np.ndarray) -> np.ndarray:
    """(rows, columns) bool: cells near voxels, or with foreground."""
    rows, columns = marks.shape
    shown = np.zeros((rows * CELL, columns * CELL), bool)
    shown[: evidence.shape[0], : evidence.shape[1]] = evidence > 0
    foreground = shown.reshape(rows, CELL, columns, CELL).any((1, 3))
    size = 2 * REACH + 1
    person: np.ndarray = foreground | ndimage.binary_dilation(marks, np.ones((size, size)))
    return person

"""The NumPy twin of `psfs.background.adaptation.Adaptation`."""

from __future__ import annotations

import numpy as np
import scipy

from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.cameras.cells import CELL
from psfs.reference.light import relight
from psfs.reference.silhouette import expand_cells, picture_masks
from psfs.silhouettes.config import SilhouetteConfig


class NumpyAdaptation:
    """The same results; `background` is the updated background, a copy of the given one in
    float64."""

    def __init__(self, rig: CameraRig, background: Background, config: SilhouetteConfig) -> None:
        self.config, self._reach = config.adaptation, config.appearance.reach
        self._sigma_floor = config.background.sigma_floor
        std = np.maximum(background.std, self._sigma_floor).astype(np.float64)
        self.background = Background(background.mean.astype(np.float64), std)
        self._inside = picture_masks(rig)
        self._frames = 0

    def __call__(
        self, images: np.ndarray, evidence: np.ndarray, marks: np.ndarray, light: np.ndarray
    ) -> None:
        """Update the background by images (V, H, W, 3) uint8 with evidence counts (V, H, W), marks
        (V, rows, columns) bool and light (V, LIGHT_FLOATS)."""
        due = np.arange(marks.shape[1]) % self.config.period == self._frames % self.config.period
        self._frames += 1
        mean_rate, variance_rate = self.config.rates()
        for view, image in enumerate(relight(images, light)):
            mean, std = self.background.mean[view], self.background.std[view]
            free = expand_cells(~_person(marks[view], evidence[view], self._reach), image.shape)
            difference, updated = image - mean, self._inside[view].copy()
            updated &= expand_cells(np.broadcast_to(due[:, None], marks[view].shape), image.shape)
            distance = light[view, 9] * ((difference / std) ** 2).sum(-1)
            pixels = updated & free & (distance <= self.config.nearest)
            d, variance = difference[pixels], std[pixels] ** 2
            mean[pixels] += mean_rate * d
            variance += variance_rate * (d**2 - variance)
            std[pixels] = np.maximum(np.sqrt(variance), self._sigma_floor)


def _person(marks: np.ndarray, evidence: np.ndarray, reach: int) -> np.ndarray:
    """Return (rows, columns) bool: cells near voxels, or with foreground."""
    rows, columns = marks.shape
    shown = np.zeros((rows * CELL, columns * CELL), bool)
    shown[: evidence.shape[0], : evidence.shape[1]] = evidence > 0
    foreground = shown.reshape(rows, CELL, columns, CELL).any((1, 3))
    size = 2 * reach + 1
    return foreground | scipy.ndimage.binary_dilation(marks, np.ones((size, size)))

"""The NumPy twin of `psfs.silhouettes.appearance.Foreground`."""

from __future__ import annotations

import numpy as np
import scipy

from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import CELL, cells, voxel_footprints
from psfs.silhouettes.appearance import BINS, location_odds, max_samples
from psfs.silhouettes.config import SilhouetteConfig
from psfs.voxels.grid import VoxelGrid


class NumpyForeground:
    """The same results as `Foreground`; `learn` takes the pictures, evidence and surface.

    colours, location: as in `ForegroundPrior`.
    """

    def __init__(self, rig: CameraRig, config: SilhouetteConfig) -> None:
        self.rig, self.config, self.appearance = rig, config, config.appearance
        self.colours: np.ndarray = np.zeros(BINS**3, np.int8)
        self.location = np.zeros((len(rig), *cells(rig)), np.int8)
        self.marked = np.zeros(self.location.shape, bool)
        self._memory = np.zeros((BINS,) * 3)
        self._total = 0.0

    def learn(
        self, images: np.ndarray, evidence: np.ndarray, grid: VoxelGrid, surface: np.ndarray
    ) -> None:
        """Fit the model to images (V, H, W, 3) uint8, evidence counts (V, H, W) and the surface
        voxels made of them, flat indices (N,)."""
        marked = self.marks(grid, surface)
        self.marked = marked
        self.location[:] = 0
        if len(surface) >= self.appearance.min_surface:
            size = 2 * self.appearance.reach + 1
            near = [
                scipy.ndimage.convolve(
                    view.astype(int), np.ones((size, size), int), mode="constant"
                )
                for view in marked
            ]
            self.location = location_odds(self.config)[np.stack(near)]
        self._count(images, evidence, marked)

    def forget_location(self) -> None:
        self.location[:] = 0

    def marks(self, grid: VoxelGrid, surface: np.ndarray) -> np.ndarray:
        """Return (V, rows, columns) bool: cells that show a voxel."""
        centres = grid.centres(surface)
        coarse = self.rig.scaled(1 / CELL)
        extents = voxel_footprints(coarse, grid.voxel_size)
        marked = np.zeros(self.location.shape, bool)
        last = np.array(marked.shape[:0:-1]) - 1
        for view, camera in enumerate(coarse):
            pixels, depth = camera.project(centres)
            pixels, depth = pixels[depth > 0], depth[depth > 0]
            half = extents[view] / depth[:, None]
            low = np.maximum(np.ceil(pixels - half), 0)
            high = np.minimum(np.floor(pixels + half), last)
            boxes = np.column_stack([low, high])[(low <= high).all(1)].astype(int)
            for x0, y0, x1, y1 in np.unique(boxes, axis=0):
                marked[view, y0 : y1 + 1, x0 : x1 + 1] = True
        return marked

    def _count(self, images: np.ndarray, evidence: np.ndarray, marked: np.ndarray) -> None:
        """Count the colours of the person."""
        middle = CELL // 2
        seen = evidence[:, middle::CELL, middle::CELL] > 0
        samples = images[:, middle::CELL, middle::CELL][seen].astype(int) * BINS // 256
        samples = samples[marked[:, : seen.shape[1], : seen.shape[2]][seen]]
        self._memory *= self.appearance.keep
        self._total *= self.appearance.keep
        if len(samples) <= max_samples(self.rig, self.appearance):
            np.add.at(self._memory, tuple(samples.T), 1)
            self._total += len(samples)
        blurred = self._memory
        for axis in range(3):
            blurred = scipy.ndimage.convolve1d(blurred, [0.25, 0.5, 0.25], axis, mode="constant")
        prior, uniform = self.appearance.prior_samples, self.appearance.uniform
        density = (prior + blurred * BINS**3) / (prior + self._total)
        nats = np.log(uniform + (1 - uniform) * density)
        counts = np.minimum(np.rint(self.config.evidence.ratio_steps * nats), 127)
        self.colours = counts.astype(np.int8).reshape(self.colours.shape)

"""A coarse visual hull from all cameras, which bounds where a person may appear in each."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import find_seen_box, required_views


class CoarseHull:
    """Coarse voxels, at most `voxels` of them, around the regions (V, h, w) bool that enough
    cameras see, for tests with masks (V, h, w) of the rig's size.

    A voxel is occupied if it lies in the hull of the regions, and at most a given number of the
    cameras that see it deny it, having no mask there.
    """

    def __init__(self, rig: CameraRig, regions: np.ndarray, voxels: int) -> None:
        self.rig = rig
        self._needed = required_views(rig)
        box = find_seen_box(rig, self._needed) or (np.full(3, -1.0), np.full(3, 1.0))
        for _ in range(2):  # the second grid bounds the hull of the first
            self._use_box(*box, voxels)
            inside = self.find_occupied(regions)
            if not inside.any():
                break
            found = self.centres[inside]
            box = found.min(0) - self.edge, found.max(0) + self.edge
        self.inside = inside

    def _use_box(self, low: np.ndarray, high: np.ndarray, voxels: int) -> None:
        self.edge = float(np.cbrt(np.prod(high - low) / voxels))
        axes = [np.arange(a, b, self.edge) + self.edge / 2 for a, b in zip(low, high, strict=True)]
        self.centres = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
        self._at, self._across = [], []
        for camera in self.rig:
            inside, row, column, depth = camera.look_up(self.centres)
            self._at.append((np.flatnonzero(inside), row * self.rig.width + column))
            nearest = float(np.percentile(depth, 10)) if len(depth) else np.inf
            self._across.append(max(1, int(np.ceil(self.edge * camera.K[0, 0] / nearest))))
        self._seeing = np.zeros(len(self.centres), np.int16)
        for seen, _ in self._at:
            self._seeing[seen] += 1
        self.inside = self._seeing >= self._needed

    def find_occupied(self, masks: np.ndarray, denials: int = 0) -> np.ndarray:
        """Return (voxels,) bool: the voxels that at most `denials` cameras deny; of three cameras,
        none may."""
        denials = denials if len(self.rig) > 3 else 0
        shown = np.zeros(len(self.centres), np.int16)
        for mask, (seen, pixels) in zip(masks, self._at, strict=True):
            shown[seen] += mask.ravel()[pixels]
        return self.inside & (shown >= self._seeing - denials)

    def sum_maps(self, maps: Sequence[np.ndarray]) -> np.ndarray:
        """Return (voxels,) float32: the sum of the maps (h, w) of all views where a voxel falls."""
        total = np.zeros(len(self.centres), np.float32)
        for own, (seen, pixels) in zip(maps, self._at, strict=True):
            total[seen] += own.ravel()[pixels]
        return total

    def reproject(self, occupied: np.ndarray, margin: int) -> np.ndarray:
        """Return (V, h, w) bool: the projection of the occupied voxels, dilated by `margin` px."""
        masks = np.zeros((len(self.rig), self.rig.height, self.rig.width), np.uint8)
        for mask, across, (seen, pixels) in zip(masks, self._across, self._at, strict=True):
            mask.ravel()[pixels[occupied[seen]]] = 1
            size = across + 2 * margin
            cv2.dilate(mask, np.ones((size, size), np.uint8), mask)
        return masks > 0

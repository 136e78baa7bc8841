"""Downscaling of footage: images no finer than the voxels take less time."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from apf.backend import FrameSource
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.cameras.scaling import scale_pictures
from psfs.sequence import Frame
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.occupied_box import finest_pixel


class Smaller:
    """`footage` with images resized by `factor`, at most 1; a call resizes a frame."""

    def __init__(self, footage: FrameSource, factor: float) -> None:
        self.has_images = footage.has_images
        self._whole, self._factor = footage.rig, factor
        self.rig = footage.rig.scaled(factor) if factor < 1 else footage.rig
        self.background = self._scene(footage.background)

    def __call__(self, frame: Frame) -> Frame:
        if self.rig is self._whole:
            return frame
        parts = (frame.images, frame.masks)
        images, masks = (None if part is None else self._resize(part) for part in parts)
        return replace(frame, images=images, masks=masks)

    def _scene(self, background: Background | None) -> Background | None:
        """Return the background with all its per-pixel data resized."""
        if background is None or self.rig is self._whole:
            return background
        values = {of.name: getattr(background, of.name) for of in fields(background)}
        pixels: dict[str, Any] = {
            name: self._resize(value)
            for name, value in values.items()
            if isinstance(value, np.ndarray) and value.ndim > 2
        }
        return replace(background, **pixels)

    def _resize(self, pictures: np.ndarray) -> np.ndarray:
        return scale_pictures(pictures, self._whole, self.rig, self._factor)


def fitting_factor(rig: CameraRig, grid: VoxelGrid) -> float:
    """Return the factor of images that are halved repeatedly until a pixel covers a voxel of
    `grid`."""
    halves = int(np.log2(max(grid.voxel_size / finest_pixel(rig, grid), 1.0)))
    return float(0.5**halves)

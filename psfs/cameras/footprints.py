"""Pixels that a voxel covers in a picture."""

from __future__ import annotations

import numpy as np

from psfs.cameras.camera import Camera, CameraRig


def voxel_footprints(rig: CameraRig, voxel_size: float) -> np.ndarray:
    """Return half the width and height (V, 2) of a projected voxel times its depth, px m.

    A cube of edge s rotated by R extends s times the sum of a row of |R| along a camera axis. Boxes
    of this size leave no gap between neighbouring voxels, however the camera is rotated.
    """
    spans = [np.abs(camera.R[:2]).sum(1) * np.diag(camera.K)[:2] for camera in rig]
    return 0.5 * voxel_size * np.array(spans)


def pixel_boxes(
    camera: Camera, centres: np.ndarray, footprint: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Find the pixel box that each voxel around `centres` (N, 3) m covers in the picture.

    Returns, for the K voxels that are visible, their indices (K,), first column and row (K, 2),
    last column and row + 1 (K, 2), and depths (K,) m. footprint: (2,), one row of
    `voxel_footprints`. A voxel covers at least the nearest pixel, however small it is.
    """
    pixels, depth = camera.project(centres)
    front = np.flatnonzero(depth > 0)
    pixels, depth = pixels[front], depth[front]
    half, nearest = footprint / depth[:, None], np.floor(pixels + 0.5)
    low = np.maximum(np.minimum(np.ceil(pixels - half), nearest), 0)
    last = np.maximum(np.floor(pixels + half), nearest)
    end = np.minimum(last + 1, np.array(camera.size, float))
    hit = (low < end).all(1)
    return front[hit], low[hit].astype(int), end[hit].astype(int), depth[hit]

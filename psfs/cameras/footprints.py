"""How many pixels a voxel covers."""

from __future__ import annotations

import numpy as np

from psfs.cameras.camera import Camera, CameraRig


def footprints(rig: CameraRig, voxel_size: float) -> np.ndarray:
    """Return half the width and height (V, 2) of a projected voxel's box times its depth, px m.

    A cube of edge s turned by R spans s times the sum of a row of |R| along a camera axis; so no
    hole opens between neighbouring voxels, however the camera is turned.
    """
    spans = [np.abs(camera.R[:2]).sum(1) * np.diag(camera.K)[:2] for camera in rig]
    return 0.5 * voxel_size * np.array(spans)


def pixel_boxes(
    camera: Camera, centres: np.ndarray, footprint: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the pixels that voxels around `centres` (N, 3) m cover in the picture: the numbers
    (K,) of the voxels that show, first and last + 1 column and row (K, 2) each, and depths (K,) m.

    footprint: (2,), see `footprints`. The nearest pixel is covered however small a voxel is.
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

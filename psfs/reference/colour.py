"""Colours of the surface voxels (Song et al. 3.3)."""

from __future__ import annotations

import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.footprints import pixel_boxes, voxel_footprints
from psfs.voxels.colour import TOLERANCE
from psfs.voxels.grid import VoxelGrid


def nearest_depth(
    camera: Camera, centres: np.ndarray, footprint: np.ndarray, shape: tuple[int, int]
) -> np.ndarray:
    """Return (H, W) depth in m of the nearest voxel, infinite where there is none; see
    `voxel_footprints`."""
    _, low, high, depth = pixel_boxes(camera, centres, footprint)
    extent = high - low
    buffer = np.full(shape, np.inf)
    for dx, dy in np.ndindex(*extent.max(0, initial=0)):
        covers = (extent > (dx, dy)).all(1)
        column, row = low[covers].T
        np.minimum.at(buffer, (row + dy, column + dx), depth[covers])
    return buffer


def surface_colour(
    rig: CameraRig,
    grid: VoxelGrid,
    surface: np.ndarray,
    images: np.ndarray,
    evidence: np.ndarray,
) -> np.ndarray:
    """Return (N, 4) uint8 RGB of the voxels with flat indices `surface`, and the number of cameras
    in the mean; images (V, H, W, 3) BGR. See `psfs.voxels.colour.SurfaceColour`."""
    centres = grid.centres(surface)
    sums = np.zeros((2, len(centres), 3), int)  # seen within the silhouette, seen at all
    numbers = np.zeros((2, len(centres)), int)
    least, least_colour = np.full(len(centres), np.inf), np.zeros((len(centres), 3), int)
    extents = voxel_footprints(rig, grid.voxel_size)
    for view, camera in enumerate(rig):
        buffer = nearest_depth(camera, centres, extents[view], images.shape[1:3])
        inside, row, column, depth = camera.look_up(centres)
        voxels, rgb = np.flatnonzero(inside), images[view, row, column, ::-1].astype(int)
        behind = depth - buffer[row, column]
        seen = behind <= TOLERANCE * grid.voxel_size
        for kind, counts in enumerate((seen & (evidence[view, row, column] > 0), seen)):
            sums[kind][voxels[counts]] += rgb[counts]
            numbers[kind][voxels[counts]] += 1
        nearer = ~seen & (behind < least[voxels])
        least[voxels[nearer]], least_colour[voxels[nearer]] = behind[nearer], rgb[nearer]
    chosen = np.where(numbers[0] > 0, 0, 1), np.arange(len(centres))
    number, total = numbers[chosen], sums[chosen]
    shared = np.maximum(number, 1)[:, None]
    mean = np.where(number[:, None] > 0, (total + shared // 2) // shared, least_colour)
    return np.concatenate([mean, number[:, None]], 1).astype(np.uint8)

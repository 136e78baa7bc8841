"""Estimation of the reconstruction volume, if none is stated, from the rig and the first
silhouettes."""

from __future__ import annotations

import cv2
import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import intersect_axes_ahead
from psfs.common.progress import map_in_threads
from psfs.common.regions import find_largest_region_box
from psfs.silhouettes.hidden import UNKNOWN
from psfs.voxels.grid import VoxelGrid

#: Least distance, m, of the cameras from the middle for a rig that films people; edge, m, of a
#: voxel for them, and the greatest number of voxels along the longest side.
_PEOPLE_DISTANCE, _PEOPLE_VOXEL, _FINEST = 1.5, 0.02, 400
#: Number of voxels along the longest side for objects.
_FINE = 150
#: Height, m, below which the search ignores everything, for rigs that film people.
FLOOR = -0.1


def default_voxel_size(
    rig: CameraRig, low: np.ndarray, high: np.ndarray, *, objects: bool = False
) -> float:
    """Return the edge of a voxel, m: 2 cm if the cameras are as far away as people need, else 1/150
    of the longest side. objects: no distance counts as that of people."""
    middle = (np.asarray(low) + np.asarray(high)) / 2
    distance = np.median(np.linalg.norm(rig.centres - middle, axis=1))
    longest = float(np.max(np.asarray(high) - low))
    if distance >= _PEOPLE_DISTANCE and not objects:
        return max(_PEOPLE_VOXEL, longest / _FINEST)
    return longest / _FINE


def finest_pixel(rig: CameraRig, grid: VoxelGrid) -> float:
    """Return the least width that a pixel of any camera covers in the middle of the grid, m."""
    distances = np.linalg.norm(rig.centres - (grid.low + grid.high) / 2, axis=1)
    focal = [camera.K[[0, 1], [0, 1]].max() for camera in rig]
    return float(np.min(distances / focal))


def reachable_box(rig: CameraRig, floor: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return a box, m, around the point that the cameras look at, which reaches as far as the
    cameras.

    The point is the nearest one to all optical axes; the box reaches as far as the median camera
    stands from it. With `floor`, the box of a rig large enough for people ends at z = -0.1.
    """
    target = intersect_axes_ahead(rig)
    reach = float(np.median(np.linalg.norm(rig.centres - target, axis=1)))
    low, high = target - reach, target + reach
    if floor and reach >= _PEOPLE_DISTANCE and low[2] < FLOOR < high[2]:
        low[2] = FLOOR
    return low, high


def largest_parts_box(
    rig: CameraRig, evidence: list[np.ndarray], grid: VoxelGrid, min_cameras: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the box, m, around the largest connected parts of all frames; None if there are none.
    evidence: maps of each frame, from `remove_speckle`."""
    centres = grid.centres()

    def look(view: int) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the voxels that a camera sees, and their evidence in each frame."""
        camera = rig[view]
        inside, row, column, depth = camera.look_up(centres)
        if not len(depth):
            return np.zeros(0, int), [np.zeros(0, int)] * len(evidence)
        covered = grid.voxel_size * camera.K[0, 0] / float(np.median(depth))
        pixels = row * rig.width + column
        counts = [_dilate_foreground(maps[view], covered).ravel()[pixels] for maps in evidence]
        return np.flatnonzero(inside), [np.where(of == UNKNOWN, 0, of) for of in counts]

    votes = np.zeros((len(evidence), grid.size), np.int32)
    seeing = np.zeros(grid.size, np.int32)
    for seen, counts in map_in_threads(look, range(len(rig))):
        seeing[seen] += 1
        for frame, of in enumerate(counts):
            votes[frame, seen] += of
    occupied = (votes > 0) & (seeing >= min_cameras)
    shapes = [frame.reshape(grid.shape) for frame in occupied]
    parts = list(map_in_threads(find_largest_region_box, shapes))
    corners = np.array([part for part in parts if part is not None])
    if not len(corners):
        return None
    low, high = corners[:, 0].min(0), corners[:, 1].max(0)
    return grid.origin + low * grid.voxel_size, grid.origin + high * grid.voxel_size


def remove_speckle(evidence: np.ndarray) -> np.ndarray:
    """Return evidence maps (V, H, W) int8 after a 5x5 median."""
    return np.stack([_to_evidence(cv2.medianBlur(_bytes(view), 5)) for view in evidence])


def _dilate_foreground(evidence: np.ndarray, pixels: float) -> np.ndarray:
    """Return evidence (H, W) with the foreground dilated by a voxel that is `pixels` wide."""
    size = max(1, round(pixels))
    return _to_evidence(cv2.dilate(_bytes(evidence), np.ones((size, size), np.uint8)))


def _bytes(evidence: np.ndarray) -> np.ndarray:
    """Return int8 values as uint8 in the same order, as OpenCV needs them."""
    return evidence.view(np.uint8) ^ np.uint8(128)


def _to_evidence(raised: object) -> np.ndarray:
    return (np.asarray(raised, np.uint8) ^ np.uint8(128)).view(np.int8)

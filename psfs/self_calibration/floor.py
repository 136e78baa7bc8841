"""Height of the floor from slices of the person's visual hull.

On the floor the silhouettes of all cameras agree about the feet, and about the person's shadow if
they show it; a few centimetres above or below, each camera sees the shadow elsewhere (planar
homographies: Khan & Shah, ECCV 2006). So the largest slice is at the floor if it is that of a
shadow: wider than a foot, and larger than the slices above. Without a shadow, slices grow from the
soles upwards, and the floor is below them.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.common.numbers import pick_evenly
from psfs.diagnostics.frontier import SilhouetteContours

#: Frames that are used; greatest distance of the floor from the lowest points, step of the slices,
#: half of a slice's side and its cell, m.
_FRAMES, _AROUND, _STEP, _SIDE, _CELL = 25, 0.2, 0.01, 0.6, 0.03
#: Width above which the largest slice is a shadow on the floor, m: feet are 0.10 to 0.15 m wide.
_FOOT = 0.2
#: Height above it at which a shadow is no longer seen, m, and its greatest area there, as a share.
_ABOVE, _THIN = 0.05, 0.8
#: Area of the lowest slice of feet, as a share of the largest slice's.
_LOWEST = 0.1


def measure_floor(
    rig: CameraRig, contours: Sequence[SilhouetteContours], shifts: np.ndarray,
    frames: np.ndarray, places: np.ndarray,
) -> float:  # fmt: skip
    """Return the height of the floor, m, of cameras with Z up, searched around Z = 0; zero if
    nothing is seen there.

    contours: of each camera, whose frame is `frames` (F,) + shifts[view]. places: (F, 2) the person
    on the floor in these frames.
    """
    steps = np.arange(-_AROUND, _AROUND + _STEP, _STEP)
    sides = np.arange(-_SIDE, _SIDE + _CELL, _CELL)
    grid = np.stack(np.meshgrid(steps, sides, sides, indexing="ij"), axis=-1)[..., [1, 2, 0]]
    areas, widths = [], []
    for index in pick_evenly(len(frames), _FRAMES):
        place = np.append(places[index], 0)
        slices = _carve(rig, contours, shifts + frames[index], grid + place)
        areas.append(slices.sum(axis=(1, 2)))
        largest = np.pad(slices[areas[-1].argmax()].view(np.uint8), 1)
        widths.append(2 * _CELL * cv2.distanceTransform(largest, cv2.DIST_L2, 3).max())
    total = np.sum(areas, axis=0)
    if not total.any():
        return 0.0
    width, largest = np.average(widths, weights=np.max(areas, axis=1)), total.argmax()
    above = np.searchsorted(steps, steps[largest] + _ABOVE).clip(max=len(steps) - 1)
    if width > _FOOT and total[above] < _THIN * total[largest]:
        return float(steps[largest])
    return float(steps[np.argmax(total > _LOWEST * total.max())])


def _carve(
    rig: CameraRig, contours: Sequence[SilhouetteContours], frames: np.ndarray, grid: np.ndarray
) -> np.ndarray:
    """Return which points (..., 3) m lie in the silhouettes of all cameras that see them, three or
    more, in the cameras' frames (V,)."""
    points = grid.reshape(-1, 3)
    outside, seen = np.zeros(len(points), bool), np.zeros(len(points), int)
    for camera, own, frame in zip(rig, contours, frames, strict=True):
        mask = _fill(camera, own, frame)
        if mask is not None:
            shown, rows, columns, _ = camera.look_up(points)
            outside[shown] |= mask[rows, columns] == 0
            seen += shown
    return (~outside & (seen >= 3)).reshape(grid.shape[:-1])


def _fill(camera: Camera, contours: SilhouetteContours, frame: int) -> np.ndarray | None:
    """Return the silhouette (h, w) uint8 inside a frame's contour; None without one."""
    first, last = np.searchsorted(contours.frames, [frame, frame + 1])
    if first == last:
        return None
    mask = np.zeros(camera.size[::-1], np.uint8)
    cv2.fillPoly(mask, [contours.points[first:last].astype(np.int32)], 1)
    return mask

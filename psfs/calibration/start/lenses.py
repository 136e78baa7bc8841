"""Estimate a camera's intrinsics from pictures of a board, or assume usual ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from psfs.calibration.targets.target import Sighting, Target
from psfs.cameras.camera import Camera
from psfs.common.numbers import pick_evenly

#: Default focal length of an unknown camera, in units of the longer side of its picture.
_DEFAULT_FOCAL = 1.1
#: Range of plausible focal lengths, in longer sides; outside it the estimate is rejected.
_FOCAL_RANGE = (0.3, 10.0)
#: Focal lengths that are tried for an unknown lens, in longer sides.
FOCALS = np.geomspace(0.5, 3.0, 25)
#: Pictures of the board below which a simple lens is assumed.
_FEW = 4
#: A picture is left out if its error exceeds this times the median.
_MAX_RELATIVE_ERROR = 3.0


def default_camera(name: str, size: tuple[int, int], focal: float = _DEFAULT_FOCAL) -> Camera:
    """Return a camera at the origin without distortion; focal: in units of the longer side."""
    f = focal * max(size)
    K = np.array([[f, 0, (size[0] - 1) / 2], [0, f, (size[1] - 1) / 2], [0, 0, 1.0]])
    return Camera(name, K, np.zeros(5), np.eye(3), np.zeros(3), size)


def with_focal_length(camera: Camera, share: float) -> Camera:
    """Return the camera with another focal length, in units of the longer side."""
    return camera.refocused(share * max(camera.size) / camera.K[0, 0])


def estimate_camera_from_boards(
    name: str, size: tuple[int, int], target: Target, sightings: Sequence[Sighting]
) -> Camera:
    """Estimate a camera from pictures of the board (cv2.calibrateCamera; k1 k2 p1 p2).

    Returns the default camera if the pictures do not determine it.
    """
    usual = default_camera(name, size)
    chosen = [sightings[k] for k in pick_evenly(len(sightings))]
    if len(chosen) < 3:
        return usual
    try:
        K, lens, off = _calibrate(size, target, chosen)
        sound = off < max(
            _MAX_RELATIVE_ERROR * float(np.median(off)), 1.0
        )  # false detections spoil the lens
        if 3 <= sound.sum() < len(chosen):
            chosen = [sighting for sighting, good in zip(chosen, sound, strict=True) if good]
            K, lens, _ = _calibrate(size, target, chosen)
    except cv2.error:  # all boards are parallel to the picture
        return usual
    focal = np.array([K[0, 0], K[1, 1]]) / max(size)
    if not (
        np.isfinite(K).all() and focal.min() > _FOCAL_RANGE[0] and focal.max() < _FOCAL_RANGE[1]
    ):
        return usual
    return Camera(name, K, lens[:5], np.eye(3), np.zeros(3), size)


def _calibrate(
    size: tuple[int, int], target: Target, sightings: Sequence[Sighting]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return K (3, 3), distortion (5,) and every picture's error, px."""
    flags = cv2.CALIB_FIX_K3
    if len(sightings) < _FEW:
        flags |= cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_PRINCIPAL_POINT
    points = [target.points[s.ids].astype(np.float32) for s in sightings]
    pixels = [s.pixels.astype(np.float32)[:, None] for s in sightings]
    nothing: Any = None
    result = cv2.calibrateCameraExtended(points, pixels, size, nothing, nothing, flags=flags)
    return result[1], result[2].ravel(), result[-1].ravel()

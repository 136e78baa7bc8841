"""Intrinsics of a camera from pictures of a board, or none yet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from psfs.calibration.targets.target import Sighting, Target
from psfs.cameras.camera import Camera

#: Focal length of a camera of which nothing is known, of the longer side of its picture.
_USUAL = 1.1
#: Focal lengths, of the longer side, beyond which pictures of a board did not tell it.
_FOCALS = (0.3, 10.0)
#: Pictures of the board that are used, and below which the lens is taken to be plain.
_MOST, _FEW = 40, 4
#: Times the median error of a picture that is left out.
_OFF = 3.0


def usual_camera(name: str, size: tuple[int, int], focal: float = _USUAL) -> Camera:
    """Return a camera at the origin whose focal length is `focal` of the longer side, without
    distortion."""
    f = focal * max(size)
    K = np.array([[f, 0, (size[0] - 1) / 2], [0, f, (size[1] - 1) / 2], [0, 0, 1.0]])
    return Camera(name, K, np.zeros(5), np.eye(3), np.zeros(3), size)


def camera_from_boards(
    name: str, size: tuple[int, int], target: Target, sightings: Sequence[Sighting]
) -> Camera:
    """Return the camera that sees the board so (cv2.calibrateCamera; k1 k2 p1 p2); the usual one
    where the pictures do not tell."""
    usual = usual_camera(name, size)
    picked = np.unique(np.linspace(0, len(sightings) - 1, _MOST).round().astype(int))
    chosen = [sightings[k] for k in picked] if sightings else []
    if len(chosen) < 3:
        return usual
    try:
        K, lens, off = _calibrated(size, target, chosen)
        sound = off < max(_OFF * float(np.median(off)), 1.0)  # false detections bend the lens
        if 3 <= sound.sum() < len(chosen):
            chosen = [sighting for sighting, good in zip(chosen, sound, strict=True) if good]
            K, lens, _ = _calibrated(size, target, chosen)
    except cv2.error:  # of boards that are all parallel to the picture
        return usual
    focal = np.array([K[0, 0], K[1, 1]]) / max(size)
    if not (np.isfinite(K).all() and focal.min() > _FOCALS[0] and focal.max() < _FOCALS[1]):
        return usual
    return Camera(name, K, lens[:5], np.eye(3), np.zeros(3), size)


def _calibrated(
    size: tuple[int, int], target: Target, sightings: Sequence[Sighting]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return K (3, 3), distortion (5,) and every picture's error, px."""
    flags = cv2.CALIB_FIX_K3
    if len(sightings) < _FEW:
        flags |= cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_PRINCIPAL_POINT
    points = [target.points[s.ids].astype(np.float32) for s in sightings]
    pixels = [s.pixels.astype(np.float32)[:, None] for s in sightings]
    nothing: Any = None
    found = cv2.calibrateCameraExtended(points, pixels, size, nothing, nothing, flags=flags)
    return found[1], found[2].ravel(), found[-1].ravel()

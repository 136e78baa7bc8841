"""Faults that a calibration shows by itself: a camera in another unit than the others."""

from __future__ import annotations

import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.cameras.distortion import undistort
from psfs.diagnostics.fault import Fault

#: A camera has another unit, or another world, if it is this many times as far from the others as
#: they are from each other.
_FAR = 15.0
#: Range of focal lengths as shares of the picture's longer side: fields of view of 152 to 0.6
#: degrees.
_FOCAL = (0.125, 100.0)
#: Largest ratio of the focal lengths along a picture's sides: pixels are nearly square.
_OBLONG = 2.0
#: Largest factor by which a lens moves the middle of a picture's side.
_DISTORTED = 3.0


def find_rig_faults(rig: CameraRig) -> list[Fault]:
    """Return the cameras whose calibration has another unit than the others', a focal length in mm
    instead of pixels, or a lens that forms no picture."""
    return [*_check_focal_lengths(rig), *_check_lenses(rig), *_find_far_camera(rig)]


def _check_focal_lengths(rig: CameraRig) -> list[Fault]:
    faults = []
    for camera in rig:
        focal, longest = float(camera.K[0, 0]), max(camera.size)
        oblong = float(camera.K[1, 1]) / focal
        if not 1 / _OBLONG <= oblong <= _OBLONG:
            text = (
                f"camera {camera.name}: focal lengths of {focal:.3g} and {camera.K[1, 1]:.3g} px; "
                "expected about the same along both sides"
            )
            faults.append(Fault("focal", (camera.name,), text))
        elif not _FOCAL[0] <= focal / longest <= _FOCAL[1]:
            width, height = camera.size
            text = (
                f"camera {camera.name}: a focal length of {focal:.3g} px for pictures of {width} x "
                f"{height} px; expected pixels, not mm"
            )
            faults.append(Fault("focal", (camera.name,), text))
    return faults


def _check_lenses(rig: CameraRig) -> list[Fault]:
    """Return the cameras whose distortion leaves no ray for the middle of the picture's nearest
    side, or moves it by a factor."""
    faults = []
    for camera in rig:
        side = min(camera.size) / 2
        radius = side / float(camera.K[[0, 1], [0, 1]].mean())
        x, y = undistort(camera.distortion, np.array([radius, 0.0]), np.array([0.0, radius]))
        moved = np.hypot(x, y) / radius
        if not (moved < _DISTORTED).all() or not (moved > 1 / _DISTORTED).all():
            coefficients = ", ".join(f"{value:.3g}" for value in camera.distortion)
            text = (
                f"camera {camera.name}: its distortion ({coefficients}) forms no picture up to "
                f"{side:g} px from the middle; expected coefficients k1, k2, p1, p2, k3 of focal "
                "lengths, not of pixels"
            )
            faults.append(Fault("lens", (camera.name,), text))
    return faults


def _find_far_camera(rig: CameraRig) -> list[Fault]:
    """Return the one camera that is far from the others, if there is one."""
    if len(rig) < 4:
        return []
    apart = np.linalg.norm(rig.centres[:, None] - rig.centres[None], axis=-1)
    view = int(apart.sum(0).argmax())
    others = np.delete(np.arange(len(rig)), view)
    near, far = float(apart[np.ix_(others, others)].max()), float(apart[view, others].min())
    if not far > _FAR * near > 0:
        return []
    text = (
        f"camera {rig.names[view]} stands {far:,.4g} m from the others, which stand within "
        f"{near:.3g} m: its translation is in another unit, or its calibration of another world"
    )
    return [Fault("far", (rig.names[view],), text)]

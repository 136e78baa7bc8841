"""Faults that a calibration shows by itself: a camera in another unit than the others."""

from __future__ import annotations

import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.diagnostics.fault import Fault

#: A camera has another unit, or another world, if it is this many times as far from the others as
#: they are from each other.
_FAR = 15.0
#: Range of focal lengths as shares of the picture's longer side: fields of view of 152 to 0.6
#: degrees.
_FOCAL = (0.125, 100.0)


def find_rig_faults(rig: CameraRig) -> list[Fault]:
    """Return the cameras whose calibration has another unit than the others', or a focal length in
    mm instead of pixels."""
    return [*_check_focal_lengths(rig), *_find_far_camera(rig)]


def _check_focal_lengths(rig: CameraRig) -> list[Fault]:
    faults = []
    for camera in rig:
        focal, longest = float(camera.K[0, 0]), max(camera.size)
        if not _FOCAL[0] <= focal / longest <= _FOCAL[1]:
            width, height = camera.size
            text = (
                f"camera {camera.name}: a focal length of {focal:.3g} px for pictures of {width} x "
                f"{height} px; expected pixels, not mm"
            )
            faults.append(Fault("focal", (camera.name,), text))
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

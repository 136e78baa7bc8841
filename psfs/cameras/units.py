"""Convert length units to metres and up axes to Z."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from cl import InputError
from psfs.cameras.camera import CameraRig
from psfs.common.numbers import METRES

#: A unit of length: "m", "cm", "mm", with a factor ("0.76mm"), or metres per unit as a number.
Unit = str | float

#: For each up axis the proper rotation that takes it to +Z; the rows are the new X, Y and Z.
_Z_UP = {
    "z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "-z": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "y": ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
    "-y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "x": ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    "-x": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
}


def metres_per_unit(unit: Unit) -> float:
    """Return the metres in one `unit`. Raises InputError for anything but a positive length."""
    match = re.fullmatch(r"\s*([0-9.eE+-]*)\s*(m|cm|mm|)\s*", str(unit)[:100])
    try:
        if isinstance(unit, bool) or not match or not (match[1] or match[2]):
            raise ValueError
        metres = float(match[1] or 1) * METRES[match[2] or "m"]
        if not 1e-9 <= metres <= 1e6:
            raise ValueError
    except ValueError:
        raise InputError(
            f"unit {unit!r} is not a length; expected m, cm, mm, a factor as in 0.76mm, "
            "or metres per unit"
        ) from None
    return metres


def rotation_to_z_up(up: str) -> np.ndarray:
    """Return the rotation (3, 3) that takes the axis `up` ("z", "-z", "y", ...) to +Z."""
    key = str(up).strip().lower().lstrip("+")
    if key not in _Z_UP:
        raise InputError(f"up axis {up!r}; expected one of {', '.join(_Z_UP)}")
    return np.array(_Z_UP[key], np.float64)


def scale_rig(rig: CameraRig, metres: float) -> CameraRig:
    """Convert a rig whose translations are in units of `metres` to metres: t' = s t."""
    return CameraRig(tuple(replace(camera, t=camera.t * metres) for camera in rig))


def rotate_rig(rig: CameraRig, rotation: np.ndarray) -> CameraRig:
    """Rotate the world of a rig to x' = A x, A = `rotation` (3, 3): R' = R A^T, t unchanged."""
    return CameraRig(tuple(replace(camera, R=camera.R @ rotation.T) for camera in rig))

"""Blender's and NeRF's `transforms.json`: `transform_matrix` (4x4) leads from the camera to the
world, its axes are OpenGL's (x right, y up, looking along -z); the lens is `camera_angle_x`, rad,
or `fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`, `k1` ... of the file or of a frame.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from cl import InputError
from psfs.cameras.calibration.colmap import camera_names
from psfs.cameras.calibration.common import (
    Calibration,
    Size,
    Sizes,
    naming,
    rig_of,
    rotation_matrix,
    whole_size,
)
from psfs.cameras.camera import MOST_CAMERAS, Camera
from psfs.cameras.names import natural_key
from psfs.cameras.units import Unit
from psfs.common.files import read_json
from psfs.common.schema import Number, Positive, Table, checked, flat

#: From OpenGL's camera axes to ours.
_AXES = np.diag([1.0, -1.0, -1.0])


class Lens(Table):
    """What the file says of all cameras, or a frame of its own."""

    camera_angle_x: Annotated[float, Field(gt=0, lt=math.pi)] | None = None
    camera_angle_y: Annotated[float, Field(gt=0, lt=math.pi)] | None = None
    fl_x: Positive | None = None
    fl_y: Positive | None = None
    cx: Number | None = None
    cy: Number | None = None
    w: Positive | None = None
    h: Positive | None = None
    k1: Number = 0.0
    k2: Number = 0.0
    k3: Number = 0.0
    p1: Number = 0.0
    p2: Number = 0.0


class View(Lens):
    """One frame."""

    file_path: str
    transform_matrix: Annotated[list[float], flat(12, 16)]


class Transforms(Lens):
    """The file."""

    frames: Annotated[list[View], Field(min_length=1, max_length=MOST_CAMERAS)]


def read_transforms(path: Path, unit: Unit | None = None, sizes: Sizes = None) -> Calibration:
    """Read the cameras in natural order of their pictures' names. Metres unless `unit` says
    otherwise; sizes are those of the pictures where the file has none."""
    file = checked(Transforms, read_json(path, "NeRF's transforms.json"), path)
    with naming(path):
        views = dict(
            zip(camera_names([v.file_path for v in file.frames]), file.frames, strict=True)
        )
        names = sorted(views, key=natural_key)
        if len(names) < len(file.frames):
            raise InputError("two frames have pictures of one name; expected a camera each")
        stated = [_of(file, views[name], "w") and _of(file, views[name], "h") for name in names]
        if all(stated):
            sizes = {name: _size(file, views[name], name) for name in names}
        return rig_of(names, sizes, lambda n, size: _camera(n, file, views[n], size), unit, "m")


def _of(file: Transforms, view: View, key: str) -> float | None:
    own = getattr(view, key) if key in view.model_fields_set else None
    value = own if own is not None else getattr(file, key)
    return None if value is None else float(value)


def _size(file: Transforms, view: View, name: str) -> Size:
    return whole_size(_of(file, view, "w") or 0, _of(file, view, "h") or 0, f"camera {name}")


def _camera(name: str, file: Transforms, view: View, size: Size) -> Camera:
    def value(key: str) -> float | None:
        return _of(file, view, key)

    width, height = size
    angle, angle_y = value("camera_angle_x"), value("camera_angle_y")
    fx = value("fl_x") or (0.5 * width / math.tan(angle / 2) if angle else None)
    if fx is None:
        raise InputError(f"camera {name}: neither fl_x nor camera_angle_x; expected one of them")
    fy = value("fl_y") or (0.5 * height / math.tan(angle_y / 2) if angle_y else fx)
    cx, cy = value("cx"), value("cy")
    # The middle of the picture is at w / 2 there, and at (w - 1) / 2 here.
    cx, cy = (width / 2 if cx is None else cx) - 0.5, (height / 2 if cy is None else cy) - 0.5
    to_world = np.array(view.transform_matrix[:12]).reshape(3, 4)
    R = rotation_matrix(_AXES @ to_world[:, :3].T, f"camera {name}: transform_matrix")
    left_handed = np.linalg.det(to_world[:, :3]) < 0
    centre = to_world[:, 3] * ([-1, 1, 1] if left_handed else [1, 1, 1])
    distortion = np.array([value(key) for key in ("k1", "k2", "p1", "p2", "k3")])
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return Camera(name, K, distortion, R, -R @ centre, size)

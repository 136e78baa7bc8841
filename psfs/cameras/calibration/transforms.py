"""Read the `transforms.json` of Blender and NeRF.

`transform_matrix` (4x4) takes camera to world coordinates; the camera's axes are OpenGL's (x right,
y up, looking along -z). The lens is `camera_angle_x`, rad, or `fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`,
`k1` ..., given for the file or for a frame. `camera_model` and instant-ngp's flags say which
lens it is: a pinhole lens, with OpenCV's distortion or none, or OpenCV's fisheye lens.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from cl import InputError
from psfs.cameras.calibration.colmap import name_cameras
from psfs.cameras.calibration.common import (
    TO_OPENCV,
    Calibration,
    Size,
    Sizes,
    build_rig,
    check_whole_size,
    name_file_in_errors,
    parse_rotation,
)
from psfs.cameras.camera import MOST_CAMERAS, Camera
from psfs.cameras.names import join_names, natural_key
from psfs.cameras.units import Unit
from psfs.common.files import read_json
from psfs.common.schema import Number, Positive, Table, flat, parse_values

#: Values of `camera_model` for OpenCV's pinhole camera and its special cases.
_PINHOLE = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "RADIAL", "SIMPLE_RADIAL", "PERSPECTIVE")
_FISHEYE = "OPENCV_FISHEYE"
#: Keys of other lenses that instant-ngp reads.
_OTHER_LENSES = ("ftheta_p0", "latlong", "equirectangular", "orthographic")


class Lens(Table):
    """Lens parameters, given for all cameras or for a single frame."""

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
    camera_model: str | None = None
    is_fisheye: Number | bool = False
    ftheta_p0: Number = 0.0
    latlong: Number | bool = False
    equirectangular: Number | bool = False
    orthographic: Number | bool = False
    k4: Number = 0.0


class FrameEntry(Lens):
    """One entry of `frames`: a picture with its pose."""

    file_path: str
    transform_matrix: Annotated[list[float], flat(12, 16)]


class Transforms(Lens):
    """The whole file."""

    frames: Annotated[list[FrameEntry], Field(min_length=1, max_length=MOST_CAMERAS)]


def read_transforms(path: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read the cameras in natural order of their pictures' names.

    Metres unless `unit` says otherwise. `sizes` are used where the file has none.
    """
    file = parse_values(Transforms, read_json(path, "NeRF's transforms.json"), path)
    with name_file_in_errors(path):
        views = dict(
            zip(name_cameras([v.file_path for v in file.frames]), file.frames, strict=True)
        )
        names = sorted(views, key=natural_key)
        if len(names) < len(file.frames):
            raise InputError("two frames have pictures of one name; expected a camera each")
        stated = [
            _lens_value(file, views[name], "w") and _lens_value(file, views[name], "h")
            for name in names
        ]
        if all(stated):
            sizes = {name: _size(file, views[name], name) for name in names}
        return build_rig(names, sizes, lambda n, size: _camera(n, file, views[n], size), unit, "m")


def _stated(file: Transforms, view: FrameEntry, key: str) -> Any:
    own = getattr(view, key) if key in view.model_fields_set else None
    return own if own is not None else getattr(file, key)


def _lens_value(file: Transforms, view: FrameEntry, key: str) -> float | None:
    value = _stated(file, view, key)
    return None if value is None else float(value)


def _is_fisheye(name: str, file: Transforms, view: FrameEntry) -> bool:
    """Return whether the lens is OpenCV's fisheye lens. Raises InputError for any but that and a
    pinhole lens with OpenCV's distortion."""
    model = (_stated(file, view, "camera_model") or "").upper()
    fisheye = model == _FISHEYE or bool(not model and _stated(file, view, "is_fisheye"))
    other = [key for key in _OTHER_LENSES if _stated(file, view, key)]
    other += ["k4"] if not fisheye and _stated(file, view, "k4") else []
    if model and model not in (*_PINHOLE, _FISHEYE):
        other.insert(0, f"camera_model {model}")
    if other:
        raise InputError(
            f"camera {name}: {join_names(other)}; expected a pinhole or fisheye camera, "
            f"{join_names((*_PINHOLE, _FISHEYE))}: undistort the pictures to one first"
        )
    return fisheye


def _size(file: Transforms, view: FrameEntry, name: str) -> Size:
    return check_whole_size(
        _lens_value(file, view, "w") or 0, _lens_value(file, view, "h") or 0, f"camera {name}"
    )


def _camera(name: str, file: Transforms, view: FrameEntry, size: Size) -> Camera:
    def value(key: str) -> float | None:
        return _lens_value(file, view, key)

    fisheye = _is_fisheye(name, file, view)
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
    R = parse_rotation(TO_OPENCV @ to_world[:, :3].T, f"camera {name}: transform_matrix")
    left_handed = np.linalg.det(to_world[:, :3]) < 0
    centre = to_world[:, 3] * ([-1, 1, 1] if left_handed else [1, 1, 1])
    keys = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    distortion = np.array([value(key) for key in keys])
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return Camera(name, K, distortion, R, -R @ centre, size, fisheye=fisheye)

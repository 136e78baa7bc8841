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

from pydantic import Field

from cl import InputError
from psfs.cameras.calibration.colmap import name_cameras
from psfs.cameras.calibration.common import (
    OPENGL_POSES,
    Calibration,
    Sizes,
    build,
    find_sizes,
    name_file_in_errors,
)
from psfs.cameras.camera import MOST_CAMERAS
from psfs.cameras.names import join_names, natural_key
from psfs.cameras.units import Unit
from psfs.common.files import read_json
from psfs.common.schema import Number, Positive, Table, flat, parse_values

#: Values of `camera_model` for OpenCV's pinhole camera and its special cases.
_PINHOLE = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "RADIAL", "SIMPLE_RADIAL", "PERSPECTIVE")
_FISHEYE = "OPENCV_FISHEYE"
#: Keys of other lenses that instant-ngp reads.
_OTHER_LENSES = ("ftheta_p0", "latlong", "equirectangular", "orthographic")


class View(Table):
    """A picture with its pose and its lens, whose keys may stand for the whole file."""

    file_path: str
    transform_matrix: Annotated[list[float], flat(12, 16)]
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
    k4: Number = 0.0
    p1: Number = 0.0
    p2: Number = 0.0
    camera_model: str = ""
    is_fisheye: Number | bool = False
    ftheta_p0: Number = 0.0
    latlong: Number | bool = False
    equirectangular: Number | bool = False
    orthographic: Number | bool = False


class Transforms(Table):
    """The whole file; further keys are the lens of all frames."""

    frames: Annotated[list[dict[str, Any]], Field(min_length=1, max_length=MOST_CAMERAS)]


def read_transforms(path: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read the cameras in natural order of their pictures' names.

    Metres unless `unit` says otherwise. `sizes` are used where the file has none.
    """
    content = read_json(path, "NeRF's transforms.json")
    frames = parse_values(Transforms, content, path).frames
    views = []
    for number, frame in enumerate(frames):
        tables = content, frame
        stated = {key: v for table in tables for key, v in table.items() if v is not None}
        views.append(parse_values(View, stated, f"{path}: frames.{number}"))
    with name_file_in_errors(path):
        named = list(zip(name_cameras([view.file_path for view in views]), views, strict=True))
        named.sort(key=lambda entry: natural_key(entry[0]))
        found = [(view.w, view.h) for _, view in named if view.w and view.h]
        if len(found) < len(named):
            found = [*find_sizes([name for name, _ in named], sizes)]
        pairs = zip(named, found, strict=True)
        records = [(name, _make_record(name, view, size)) for (name, view), size in pairs]
        return build(OPENGL_POSES, records, unit, None)


def _is_fisheye(name: str, view: View) -> bool:
    """Return whether the lens is OpenCV's fisheye lens. Raises InputError for any but that and a
    pinhole lens with OpenCV's distortion."""
    model = view.camera_model.upper()
    fisheye = model == _FISHEYE or bool(not model and view.is_fisheye)
    other = [key for key in _OTHER_LENSES if getattr(view, key)]
    other += ["k4"] if not fisheye and view.k4 else []
    if model and model not in (*_PINHOLE, _FISHEYE):
        other.insert(0, f"camera_model {model}")
    if other:
        raise InputError(
            f"camera {name}: {join_names(other)}; expected a pinhole or fisheye camera, "
            f"{join_names((*_PINHOLE, _FISHEYE))}: undistort the pictures to one first"
        )
    return fisheye


def _make_record(name: str, view: View, size: tuple[float, float]) -> dict[str, Any]:
    fisheye, (width, height) = _is_fisheye(name, view), size
    angle, angle_y = view.camera_angle_x, view.camera_angle_y
    fx = view.fl_x or (0.5 * width / math.tan(angle / 2) if angle else None)
    if fx is None:
        raise InputError(f"camera {name}: neither fl_x nor camera_angle_x; expected one of them")
    fy = view.fl_y or (0.5 * height / math.tan(angle_y / 2) if angle_y else fx)
    # The middle of the picture is at w / 2 there, and at (w - 1) / 2 here.
    cx, cy = (
        (side / 2 if centre is None else centre) - 0.5
        for side, centre in ((width, view.cx), (height, view.cy))
    )
    keys = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    return {
        "K": [fx, fy, cx, cy],
        "distortion": [getattr(view, key) for key in keys],
        "pose": view.transform_matrix,
        "size": size,
        "fisheye": fisheye,
    }

"""Read Qualisys Track Manager's calibration (`.qca.txt`), XML with one `camera` element per camera.

`transform` has the rotation from the world's axes to the camera's (x right, y up, z backward), by
rows, and the camera's position, mm; `intrinsic` has focal lengths and principal point
in 1/64 px, k1, k2, p1, p2 of OpenCV's model; `fov_video` the part of the sensor that the video
shows, px.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from cl import InputError
from psfs.cameras.calibration.common import (
    TO_OPENCV,
    Calibration,
    check_whole_size,
    convert_to_metres,
    name_file_in_errors,
    parse_rotation,
    read_attributes,
    read_text,
)
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.units import Unit
from psfs.common.xml import parse_xml

SUFFIX = ".qca.txt"
#: Units of the sensor per pixel; the camera's axes are x right, y up, z backward.
SUBPIXELS = 64
_TRANSFORM = ("r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33", "x", "y", "z")
_INTRINSIC = (
    *("focalLengthU", "focalLengthV", "centerPointU", "centerPointV"),
    *("radialDistortion1", "radialDistortion2", "tangentalDistortion1", "tangentalDistortion2"),
)
_FIELD = ("left", "top", "right", "bottom")


def looks_like_qualisys(text: str) -> bool:
    """Return whether the text begins as Qualisys' XML does."""
    return text.lstrip().startswith("<") and "<calibration" in text[:2000]


def read_qualisys(path: Path, unit: Unit | None) -> Calibration:
    """Read the cameras, named by their serial numbers. Millimetres unless `unit` says otherwise.

    Raises InputError naming file, camera and attribute.
    """
    text = read_text(path)
    with name_file_in_errors(path):
        found = parse_xml(text, "Qualisys' XML").findall("cameras/camera")
        if not found:
            raise InputError("no cameras; expected Qualisys' elements cameras/camera")
        cameras = [_camera(element, index) for index, element in enumerate(found, 1)]
        return convert_to_metres(CameraRig(tuple(cameras)), unit, default="mm")


def _camera(element: ElementTree.Element, index: int) -> Camera:
    name = element.get("serial") or f"cam{index:02d}"
    if element.find("fov_video") is None and element.find("intrinsic") is not None:
        raise InputError(
            f"camera {name}: no fov_video; expected Qualisys' own file. That of Theia3D is not "
            "read: see docs/formats.md"
        )
    if element.get("viewrotation", "0") != "0":
        turned = element.get("viewrotation")
        raise InputError(f"camera {name}: viewrotation is {turned}; expected 0")
    rotation = read_attributes(element, "transform", _TRANSFORM, name)
    fu, fv, cu, cv, k1, k2, p1, p2 = read_attributes(element, "intrinsic", _INTRINSIC, name)
    left, top, right, bottom = read_attributes(element, "fov_video", _FIELD, name)
    turn = TO_OPENCV @ rotation[:9].reshape(3, 3)
    K = np.array([[fu, 0, cu], [0, fv, cv], [0, 0, SUBPIXELS]]) / SUBPIXELS
    K[:2, 2] -= left, top
    return Camera(
        name=name,
        K=K,
        distortion=np.array([k1, k2, p1, p2]),
        R=parse_rotation(turn, f"camera {name}: transform"),
        t=-turn @ rotation[9:],
        size=check_whole_size(right - left + 1, bottom - top + 1, f"camera {name}: fov_video"),
    )

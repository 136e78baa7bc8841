"""Read OptiTrack Motive's calibration (`.mcal`, Motive 3.2 or later), XML in UTF-16 with one
`Camera` per camera.

`Extrinsic` has the camera's position, m, and by rows the rotation from the camera's axes (x right,
y up, z backward) to the world's; `IntrinsicStandardCameraModel` focal lengths and principal point,
px, and OpenCV's distortion; `Attributes` the picture's size. Y is up in Motive's world.
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
from psfs.cameras.names import natural_key
from psfs.cameras.units import Unit
from psfs.common.reading import open_input
from psfs.common.xml import parse_xml

SUFFIX = ".mcal"
_POSITION = ("X", "Y", "Z")
_ROTATION = tuple(f"OrientMatrix{number}" for number in range(9))
_LENS = ("HorizontalFocalLength", "VerticalFocalLength", "LensCenterX", "LensCenterY")
_DISTORTION = ("k1", "k2", "TangentialX", "TangentialY", "k3")
#: Marks of UTF-16, which may be absent.
_MARKS = (b"\xff\xfe", b"\xfe\xff")
_SIZE = ("ImagerPixelWidth", "ImagerPixelHeight")


def read_optitrack(path: Path, unit: Unit | None) -> Calibration:
    """Read the cameras, named by their serial numbers, in natural order; of colour cameras (C...)
    and others those for colour. Metres unless `unit` says otherwise.

    Raises InputError naming file, camera and attribute.
    """
    text = read_text(path, _find_encoding(path))
    with name_file_in_errors(path):
        found = list(parse_xml(text, "OptiTrack's XML").iter("Camera"))
        if not found:
            raise InputError("no elements Camera; expected OptiTrack Motive's calibration")
        cameras = [_camera(element, index) for index, element in enumerate(found, 1)]
        colour = [camera for camera in cameras if camera.name.upper().startswith("C")]
        chosen = sorted(colour or cameras, key=lambda camera: natural_key(camera.name))
        return convert_to_metres(CameraRig(tuple(chosen)), unit, default="m")


def _find_encoding(path: Path) -> str:
    with open_input(path, "a calibration") as file:
        head = file.read(2)
    if head in _MARKS:
        return "UTF-16"
    return "UTF-16-LE" if head == b"<\0" else "UTF-8"


def _camera(element: ElementTree.Element, index: int) -> Camera:
    name = element.get("Serial") or f"cam{index:02d}"
    if element.find("IntrinsicStandardCameraModel") is None:
        raise InputError(
            f"camera {name}: no IntrinsicStandardCameraModel; expected a calibration that Motive "
            "3.2 or later has written"
        )
    width, height = read_attributes(element, "Attributes", _SIZE, name)
    lens = read_attributes(element, "IntrinsicStandardCameraModel", (*_LENS, *_DISTORTION), name)
    turn = TO_OPENCV @ read_attributes(element, "Extrinsic", _ROTATION, name).reshape(3, 3).T
    fx, fy, cx, cy = lens[:4]
    return Camera(
        name=name,
        K=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        distortion=lens[4:],
        R=parse_rotation(turn, f"camera {name}: Extrinsic"),
        t=-turn @ read_attributes(element, "Extrinsic", _POSITION, name),
        size=check_whole_size(width, height, f"camera {name}: Attributes"),
    )

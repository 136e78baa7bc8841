"""Read calibrations in XML of systems of motion capture: Qualisys, OptiTrack, Vicon.

Read Qualisys Track Manager's calibration (`.qca.txt`), XML with one `camera` element per camera.

`transform` has the rotation from the world's axes to the camera's (x right, y up, z backward), by
rows, and the camera's position, mm; `intrinsic` has focal lengths and principal point
in 1/64 px, k1, k2, p1, p2 of OpenCV's model; `fov_video` the part of the sensor that the video
shows, px.

Read OptiTrack Motive's calibration (`.mcal`, Motive 3.2 or later), XML in UTF-16 with one
`Camera` per camera.

`Extrinsic` has the camera's position, m, and by rows the rotation from the camera's axes (x right,
y up, z backward) to the world's; `IntrinsicStandardCameraModel` focal lengths and principal point,
px, and OpenCV's distortion; `Attributes` the picture's size. Y is up in Motive's world.

Read Vicon's calibration (`.xcp`), XML with one `Camera` per camera.

Its last `KeyFrame` has the focal length and principal point in px, ORIENTATION, a quaternion
x y z w from the world's axes to the camera's (x right, y down, z forward), POSITION, mm, and
VICON_RADIAL2, a name, two numbers, then k1 k2 k3 of OpenCV's model, as Pose2Sim reads them. Cameras
without a key frame were not calibrated. Beside video cameras, those for markers are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from cl import InputError
from psfs.cameras.calibration.common import (
    OPENGL_POSES,
    PLAIN,
    Calibration,
    Layout,
    build,
    name_file_in_errors,
    parse_numbers,
    parse_quaternion,
    read_text,
)
from psfs.cameras.names import join_names
from psfs.cameras.units import Unit
from psfs.common.files import parse_xml
from psfs.common.reading import open_input

QUALISYS, OPTITRACK, VICON = ".qca.txt", ".mcal", ".xcp"
#: Units of Qualisys' sensor per pixel, and its names of a rotation's numbers by rows.
SUBPIXELS = 64
MATRIX = [f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)]
_LENS = ("HorizontalFocalLength", "VerticalFocalLength", "LensCenterX", "LensCenterY")
#: Marks of UTF-16, which may be absent.
_MARKS = (b"\xff\xfe", b"\xfe\xff")


def looks_like_qualisys(text: str) -> bool:
    """Return whether the text begins as Qualisys' XML does."""
    return text.lstrip().startswith("<") and "<calibration" in text[:2000]


def read_xml(path: Path, unit: Unit | None) -> Calibration:
    """Read the calibration of one of `_PROGRAMS`, in the unit of the program unless `unit` says
    otherwise. Cameras are named by their attribute of the table; if some film, those are read.

    Raises InputError naming file, camera and attribute.
    """
    tag, key, parse, layout = _PROGRAMS.get(path.suffix.lower(), _PROGRAMS[QUALISYS])
    text = read_text(path, _find_encoding(path))
    with name_file_in_errors(path):
        elements = parse_xml(text, f"XML with {tag}").findall(tag)
        if not elements:
            raise InputError(f"no elements {tag}; expected calibrated cameras")
        elements = [element for element in elements if _is_video(element)] or elements
        names = [element.get(key) or f"cam{index:02d}" for index, element in enumerate(elements, 1)]
        records = [
            (name, parse(at, f"camera {name}")) for name, at in zip(names, elements, strict=True)
        ]
        return build(layout, records, unit, None)


def _is_video(element: ElementTree.Element) -> bool:
    """Return whether a camera of Vicon or OptiTrack takes pictures: others see markers only."""
    colour = element.get("Serial", "").upper().startswith("C")
    return colour or "video" in element.get("TYPE", "").lower()


def _find_encoding(path: Path) -> str:
    with open_input(path, "a calibration") as file:
        head = file.read(2)
    if head in _MARKS:
        return "UTF-16"
    return "UTF-16-LE" if head == b"<\0" else "UTF-8"


def _read_numbers(
    element: ElementTree.Element | None, keys: Sequence[str], count: int, what: str
) -> np.ndarray:
    """Return the numbers (count,) in an element's attributes, one after the other. Raises
    InputError."""
    missing = [key for key in keys if element is None or key not in element.attrib]
    if element is None or missing:
        raise InputError(f"{what} lacks {join_names(missing)}")
    values = parse_numbers(" ".join(element.attrib[key] for key in keys).split(), what)
    if len(values) != count:
        raise InputError(f"{what}: {len(values)} numbers in {join_names(keys)}; expected {count}")
    return values


def _parse_qualisys(element: ElementTree.Element, what: str) -> dict[str, Any]:
    video, lens = element.find("fov_video"), element.find("intrinsic")
    if video is None and lens is not None:
        raise InputError(
            f"{what}: no fov_video; expected Qualisys' own file. That of Theia3D is not "
            "read: see docs/formats.md"
        )
    if element.get("viewrotation", "0") != "0":
        turned = element.get("viewrotation")
        raise InputError(f"{what}: viewrotation is {turned}; expected 0")
    pose = _read_numbers(element.find("transform"), [*MATRIX, *"xyz"], 12, f"{what}: transform")
    focal = ("focalLengthU", "focalLengthV", "centerPointU", "centerPointV")
    bend = [f"{kind}Distortion{k}" for kind in ("radial", "tangental") for k in (1, 2)]
    values = _read_numbers(lens, [*focal, *bend], 8, f"{what}: intrinsic")
    left, top, right, bottom = _read_numbers(
        video, ("left", "top", "right", "bottom"), 4, f"{what}: fov_video"
    )
    return {
        "K": values[:4] / SUBPIXELS - [0, 0, left, top],
        "distortion": values[4:],
        "pose": np.column_stack([pose[:9].reshape(3, 3).T, pose[9:]]),
        "size": (right - left + 1, bottom - top + 1),
    }


def _parse_optitrack(element: ElementTree.Element, what: str) -> dict[str, Any]:
    lens = element.find("IntrinsicStandardCameraModel")
    if lens is None:
        raise InputError(
            f"{what}: no IntrinsicStandardCameraModel; expected a calibration that Motive "
            "3.2 or later has written"
        )
    bend = ("k1", "k2", "TangentialX", "TangentialY", "k3")
    values = _read_numbers(lens, [*_LENS, *bend], 9, f"{what}: {lens.tag}")
    keys = [*(f"OrientMatrix{number}" for number in range(9)), *"XYZ"]
    pose = _read_numbers(element.find("Extrinsic"), keys, 12, f"{what}: Extrinsic")
    sides = ("ImagerPixelWidth", "ImagerPixelHeight")
    return {
        "K": values[:4],
        "distortion": values[4:],
        "pose": np.column_stack([pose[:9].reshape(3, 3), pose[9:]]),
        "size": _read_numbers(element.find("Attributes"), sides, 2, f"{what}: Attributes"),
    }


def _parse_vicon(element: ElementTree.Element, what: str) -> dict[str, Any]:
    frame = element.findall("KeyFrames/KeyFrame")[-1]
    keys = ("FOCAL_LENGTH", "PRINCIPAL_POINT", "ORIENTATION", "POSITION")
    focal, cx, cy, *pose = _read_numbers(frame, keys, 10, what)
    R = parse_quaternion(np.array(pose[:4]), f"{what}: ORIENTATION")
    aspect = float(parse_numbers([element.get("PIXEL_ASPECT_RATIO", "1")], what)[0])
    if not 0.1 < aspect < 10:
        raise InputError(f"{what}: PIXEL_ASPECT_RATIO is {aspect:g}; expected about 1")
    newer = frame.get("VICON_RADIAL2", "").split()[3:6]
    radial = parse_numbers(newer or frame.get("VICON_RADIAL", "").split(), f"{what}: VICON_RADIAL")
    k1, k2, k3 = np.append(radial, np.zeros(3))[:3]
    return {
        "K": [focal, focal / aspect, cx, cy],
        "distortion": [k1, k2, 0, 0, k3],
        "R": R,
        "t": -R @ pose[4:],
        "size": _read_numbers(element, ["SENSOR_SIZE"], 2, what),
    }


#: The cameras' elements, the attribute with their name, what parses one and what a record has
#: where, by the ending of a program's files.
_PROGRAMS: dict[str, tuple[str, str, Callable[..., dict[str, Any]], Layout]] = {
    QUALISYS: (
        "cameras/camera", "serial", _parse_qualisys, replace(OPENGL_POSES, program="", unit="mm")
    ),
    OPTITRACK: (".//Camera", "Serial", _parse_optitrack, OPENGL_POSES),
    VICON: (
        "Camera/KeyFrames/KeyFrame/../..", "DEVICEID", _parse_vicon,
        replace(PLAIN, program="Vicon", unit="mm"),
    ),
}  # fmt: skip

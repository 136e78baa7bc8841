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

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import scipy

from cl import InputError
from psfs.cameras.calibration.common import (
    TO_OPENCV,
    Calibration,
    check_whole_size,
    convert_to_metres,
    name_file_in_errors,
    parse_numbers,
    parse_rotation,
    read_attributes,
    read_text,
)
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.names import natural_key
from psfs.cameras.units import Unit
from psfs.common.files import parse_xml
from psfs.common.reading import open_input

QUALISYS = ".qca.txt"
#: Units of the sensor per pixel; the camera's axes are x right, y up, z backward.
SUBPIXELS = 64
_QUALISYS_TRANSFORM = ("r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33", "x", "y", "z")
_QUALISYS_INTRINSIC = (
    *("focalLengthU", "focalLengthV", "centerPointU", "centerPointV"),
    *("radialDistortion1", "radialDistortion2", "tangentalDistortion1", "tangentalDistortion2"),
)
_QUALISYS_FIELD = ("left", "top", "right", "bottom")


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
        cameras = [_camera_qualisys(element, index) for index, element in enumerate(found, 1)]
        return convert_to_metres(CameraRig(tuple(cameras)), unit, default="mm")


def _camera_qualisys(element: ElementTree.Element, index: int) -> Camera:
    name = element.get("serial") or f"cam{index:02d}"
    if element.find("fov_video") is None and element.find("intrinsic") is not None:
        raise InputError(
            f"camera {name}: no fov_video; expected Qualisys' own file. That of Theia3D is not "
            "read: see docs/formats.md"
        )
    if element.get("viewrotation", "0") != "0":
        turned = element.get("viewrotation")
        raise InputError(f"camera {name}: viewrotation is {turned}; expected 0")
    rotation = read_attributes(element, "transform", _QUALISYS_TRANSFORM, name)
    fu, fv, cu, cv, k1, k2, p1, p2 = read_attributes(
        element, "intrinsic", _QUALISYS_INTRINSIC, name
    )
    left, top, right, bottom = read_attributes(element, "fov_video", _QUALISYS_FIELD, name)
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


OPTITRACK = ".mcal"
_OPTITRACK_POSITION = ("X", "Y", "Z")
_OPTITRACK_ROTATION = tuple(f"OrientMatrix{number}" for number in range(9))
_OPTITRACK_LENS = ("HorizontalFocalLength", "VerticalFocalLength", "LensCenterX", "LensCenterY")
_OPTITRACK_DISTORTION = ("k1", "k2", "TangentialX", "TangentialY", "k3")
#: Marks of UTF-16, which may be absent.
_OPTITRACK_MARKS = (b"\xff\xfe", b"\xfe\xff")
_OPTITRACK_SIZE = ("ImagerPixelWidth", "ImagerPixelHeight")


def read_optitrack(path: Path, unit: Unit | None) -> Calibration:
    """Read the cameras, named by their serial numbers, in natural order; of colour cameras (C...)
    and others those for colour. Metres unless `unit` says otherwise.

    Raises InputError naming file, camera and attribute.
    """
    text = read_text(path, _find_encoding_optitrack(path))
    with name_file_in_errors(path):
        found = list(parse_xml(text, "OptiTrack's XML").iter("Camera"))
        if not found:
            raise InputError("no elements Camera; expected OptiTrack Motive's calibration")
        cameras = [_camera_optitrack(element, index) for index, element in enumerate(found, 1)]
        colour = [camera for camera in cameras if camera.name.upper().startswith("C")]
        chosen = sorted(colour or cameras, key=lambda camera: natural_key(camera.name))
        return convert_to_metres(CameraRig(tuple(chosen)), unit, default="m")


def _find_encoding_optitrack(path: Path) -> str:
    with open_input(path, "a calibration") as file:
        head = file.read(2)
    if head in _OPTITRACK_MARKS:
        return "UTF-16"
    return "UTF-16-LE" if head == b"<\0" else "UTF-8"


def _camera_optitrack(element: ElementTree.Element, index: int) -> Camera:
    name = element.get("Serial") or f"cam{index:02d}"
    if element.find("IntrinsicStandardCameraModel") is None:
        raise InputError(
            f"camera {name}: no IntrinsicStandardCameraModel; expected a calibration that Motive "
            "3.2 or later has written"
        )
    width, height = read_attributes(element, "Attributes", _OPTITRACK_SIZE, name)
    lens = read_attributes(
        element, "IntrinsicStandardCameraModel", (*_OPTITRACK_LENS, *_OPTITRACK_DISTORTION), name
    )
    turn = (
        TO_OPENCV @ read_attributes(element, "Extrinsic", _OPTITRACK_ROTATION, name).reshape(3, 3).T
    )
    fx, fy, cx, cy = lens[:4]
    return Camera(
        name=name,
        K=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        distortion=lens[4:],
        R=parse_rotation(turn, f"camera {name}: Extrinsic"),
        t=-turn @ read_attributes(element, "Extrinsic", _OPTITRACK_POSITION, name),
        size=check_whole_size(width, height, f"camera {name}: Attributes"),
    )


VICON = ".xcp"


def read_vicon(path: Path, unit: Unit | None) -> Calibration:
    """Read the cameras, named by their DEVICEID, in natural order. Millimetres unless `unit` says
    otherwise.

    Raises InputError naming file, camera and attribute.
    """
    text = read_text(path)
    with name_file_in_errors(path):
        found = parse_xml(text, "Vicon's XML").findall("Camera")
        placed = [element for element in found if element.find("KeyFrames/KeyFrame") is not None]
        if not placed:
            raise InputError(
                f"{len(found)} cameras, none with a KeyFrame; expected Vicon's calibrated cameras"
            )
        videos = [of for of in placed if "video" in of.get("TYPE", "").lower()]
        cameras = [
            _camera_vicon(element, index) for index, element in enumerate(videos or placed, 1)
        ]
        cameras.sort(key=lambda camera: natural_key(camera.name))
        return convert_to_metres(CameraRig(tuple(cameras)), unit, default="mm")


def _camera_vicon(element: ElementTree.Element, index: int) -> Camera:
    name = element.get("DEVICEID") or f"cam{index:02d}"
    frame = element.findall("KeyFrames/KeyFrame")[-1]
    (focal,) = _numbers_vicon(frame, "FOCAL_LENGTH", 1, name)
    quaternion = _numbers_vicon(frame, "ORIENTATION", 4, name)
    if not abs(np.linalg.norm(quaternion) - 1) < 0.01:
        raise InputError(f"camera {name}: ORIENTATION has no length of 1; expected a quaternion")
    R = scipy.spatial.transform.Rotation.from_quat(quaternion).as_matrix()
    (aspect,) = _numbers_vicon(element, "PIXEL_ASPECT_RATIO", 1, name, "1")
    if not 0.1 < aspect < 10:
        raise InputError(f"camera {name}: PIXEL_ASPECT_RATIO is {aspect:g}; expected about 1")
    cx, cy = _numbers_vicon(frame, "PRINCIPAL_POINT", 2, name)
    width, height = _numbers_vicon(element, "SENSOR_SIZE", 2, name)
    return Camera(
        name=name,
        K=np.array([[focal, 0, cx], [0, focal / aspect, cy], [0, 0, 1]]),
        distortion=_radial_vicon(frame, name),
        R=R,
        t=-R @ _numbers_vicon(frame, "POSITION", 3, name),
        size=check_whole_size(width, height, f"camera {name}: SENSOR_SIZE"),
    )


def _radial_vicon(frame: ElementTree.Element, name: str) -> np.ndarray:
    """Return k1 k2 p1 p2 k3."""
    newer = frame.get("VICON_RADIAL2", "").split()[3:6]
    words = newer or frame.get("VICON_RADIAL", "").split()
    radial = parse_numbers(words, f"camera {name}: VICON_RADIAL{'2' if newer else ''}")
    k1, k2, k3 = np.append(radial, np.zeros(3))[:3]
    return np.array([k1, k2, 0, 0, k3])


def _numbers_vicon(
    element: ElementTree.Element, key: str, count: int, name: str, default: str | None = None
) -> np.ndarray:
    text = element.get(key, default)
    if text is None:
        raise InputError(f"camera {name}: no {key}; expected {count} numbers")
    values = parse_numbers(text.split(), f"camera {name}: {key}")
    if len(values) != count:
        raise InputError(f"camera {name}: {key} has {len(values)} numbers; expected {count}")
    return values

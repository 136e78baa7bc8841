"""Read Vicon's calibration (`.xcp`), XML with one `Camera` per camera.

Its last `KeyFrame` has the focal length and principal point in px, ORIENTATION, a quaternion
x y z w from the world's axes to the camera's (x right, y down, z forward), POSITION, mm, and
VICON_RADIAL2, a name, two numbers, then k1 k2 k3 of OpenCV's model, as Pose2Sim reads them. Cameras
without a key frame were not calibrated. Beside video cameras, those for markers are left out.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from cl import InputError
from psfs.cameras.calibration.common import (
    Calibration,
    check_whole_size,
    convert_to_metres,
    name_file_in_errors,
    parse_numbers,
    read_text,
)
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.names import natural_key
from psfs.cameras.units import Unit
from psfs.common.xml import parse_xml

SUFFIX = ".xcp"


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
        cameras = [_camera(element, index) for index, element in enumerate(videos or placed, 1)]
        cameras.sort(key=lambda camera: natural_key(camera.name))
        return convert_to_metres(CameraRig(tuple(cameras)), unit, default="mm")


def _camera(element: ElementTree.Element, index: int) -> Camera:
    name = element.get("DEVICEID") or f"cam{index:02d}"
    frame = element.findall("KeyFrames/KeyFrame")[-1]
    (focal,) = _numbers(frame, "FOCAL_LENGTH", 1, name)
    quaternion = _numbers(frame, "ORIENTATION", 4, name)
    if not abs(np.linalg.norm(quaternion) - 1) < 0.01:
        raise InputError(f"camera {name}: ORIENTATION has no length of 1; expected a quaternion")
    R = Rotation.from_quat(quaternion).as_matrix()
    (aspect,) = _numbers(element, "PIXEL_ASPECT_RATIO", 1, name, "1")
    if not 0.1 < aspect < 10:
        raise InputError(f"camera {name}: PIXEL_ASPECT_RATIO is {aspect:g}; expected about 1")
    cx, cy = _numbers(frame, "PRINCIPAL_POINT", 2, name)
    width, height = _numbers(element, "SENSOR_SIZE", 2, name)
    return Camera(
        name=name,
        K=np.array([[focal, 0, cx], [0, focal / aspect, cy], [0, 0, 1]]),
        distortion=_radial(frame, name),
        R=R,
        t=-R @ _numbers(frame, "POSITION", 3, name),
        size=check_whole_size(width, height, f"camera {name}: SENSOR_SIZE"),
    )


def _radial(frame: ElementTree.Element, name: str) -> np.ndarray:
    """Return k1 k2 p1 p2 k3."""
    newer = frame.get("VICON_RADIAL2", "").split()[3:6]
    words = newer or frame.get("VICON_RADIAL", "").split()
    radial = parse_numbers(words, f"camera {name}: VICON_RADIAL{'2' if newer else ''}")
    k1, k2, k3 = np.append(radial, np.zeros(3))[:3]
    return np.array([k1, k2, 0, 0, k3])


def _numbers(
    element: ElementTree.Element, key: str, count: int, name: str, default: str | None = None
) -> np.ndarray:
    text = element.get(key, default)
    if text is None:
        raise InputError(f"camera {name}: no {key}; expected {count} numbers")
    values = parse_numbers(text.split(), f"camera {name}: {key}")
    if len(values) != count:
        raise InputError(f"camera {name}: {key} has {len(values)} numbers; expected {count}")
    return values

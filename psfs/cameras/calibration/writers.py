"""Write a rig in the calibration formats of other programs: as they read it, in their unit.

The world's axes stay: Z is up, which CMU Panoptic's and COLMAP's own files do not say.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from xml.etree import ElementTree

import cv2
import scipy

from cl import InputError
from psfs.cameras.calibration.common import TO_OPENCV
from psfs.cameras.calibration.xml_files import MATRIX, SUBPIXELS
from psfs.cameras.camera import Camera, CameraRig
from psfs.common.files import write_json, write_text, write_toml


def write_caliscope(folder: Path, rig: CameraRig) -> Path:
    """Write `camera_array.toml`: tables [cameras.N] for cam_N.mp4, from 1 on, metres."""
    tables = {
        str(number): {
            "cam_id": number,
            "rotation_count": 0,
            "ignore": False,
            "size": list(camera.size),
            "matrix": camera.K.tolist(),
            "distortions": camera.distortion.tolist(),
            "translation": camera.t.tolist(),
            "rotation": camera.R.tolist(),
        }
        for number, camera in enumerate(rig, 1)
    }
    write_toml(folder / "camera_array.toml", {"cameras": tables})
    return folder / "camera_array.toml"


def write_panoptic(folder: Path, rig: CameraRig) -> Path:
    """Write `calibration_psfs.json`, centimetres."""
    cameras = [
        {
            "name": camera.name,
            "type": "hd",
            "resolution": list(camera.size),
            "K": camera.K.tolist(),
            "distCoef": camera.distortion.tolist(),
            "R": camera.R.tolist(),
            "t": (100 * camera.t[:, None]).tolist(),
        }
        for camera in rig
    ]
    write_json(folder / "calibration_psfs.json", {"cameras": cameras})
    return folder / "calibration_psfs.json"


def write_opencv(folder: Path, rig: CameraRig) -> Path:
    """Write `calib/<camera>.yml` of OpenCV's FileStorage, metres."""
    for camera in rig:
        storage = cv2.FileStorage("x.yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
        storage.write("image_width", camera.size[0])
        storage.write("image_height", camera.size[1])
        storage.write("camera_matrix", camera.K)
        storage.write("distortion_coefficients", camera.distortion[:, None])
        storage.write("R", camera.R)
        storage.write("T", camera.t[:, None])
        write_text(folder / "calib" / f"{camera.name}.yml", storage.releaseAndGetString())
    return folder / "calib"


def write_easymocap(folder: Path, rig: CameraRig) -> Path:
    """Write `intri.yml` and `extri.yml`, metres."""
    mode = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY
    intrinsic, extrinsic = (cv2.FileStorage(f"{name}.yml", mode) for name in ("intri", "extri"))
    for storage in (intrinsic, extrinsic):
        storage.startWriteStruct("names", cv2.FILE_NODE_SEQ)
        for camera in rig:
            storage.write("", camera.name)
        storage.endWriteStruct()
    for camera in rig:
        intrinsic.write(f"K_{camera.name}", camera.K)
        intrinsic.write(f"dist_{camera.name}", camera.distortion[None])
        intrinsic.write(f"W_{camera.name}", camera.size[0])
        intrinsic.write(f"H_{camera.name}", camera.size[1])
        extrinsic.write(f"R_{camera.name}", cv2.Rodrigues(camera.R)[0])
        extrinsic.write(f"Rot_{camera.name}", camera.R)
        extrinsic.write(f"T_{camera.name}", camera.t[:, None])
    write_text(folder / "intri.yml", intrinsic.releaseAndGetString())
    write_text(folder / "extri.yml", extrinsic.releaseAndGetString())
    return folder / "intri.yml"


def write_colmap(folder: Path, rig: CameraRig) -> Path:
    """Write `sparse/0/cameras.txt`, `images.txt` and an empty `points3D.txt`: an image
    `<camera>.png` per camera, metres; pixel centres at 0.5."""
    cameras, images = ["# CAMERA_ID MODEL WIDTH HEIGHT PARAMS"], ["# IMAGE_ID Q T CAMERA_ID NAME"]
    for number, camera in enumerate(rig, 1):
        K, (k1, k2, p1, p2, k3) = camera.K, camera.distortion
        lens = [K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5, k1, k2, p1, p2]
        model = "OPENCV"
        if k3:
            model, lens = "FULL_OPENCV", [*lens, k3, 0, 0, 0]
        cameras.append(f"{number} {model} {camera.size[0]} {camera.size[1]} {_words(lens)}")
        x, y, z, w = scipy.spatial.transform.Rotation.from_matrix(camera.R).as_quat()
        pose = _words([w, x, y, z, *camera.t])
        images += [f"{number} {pose} {number} {camera.name}.png", ""]
    sparse = folder / "sparse" / "0"
    write_text(sparse / "cameras.txt", "\n".join(cameras) + "\n")
    write_text(sparse / "images.txt", "\n".join(images) + "\n")
    write_text(sparse / "points3D.txt", "# none\n")
    return sparse


def write_qualisys(folder: Path, rig: CameraRig) -> Path:
    """Write `Calib.qca.txt`, millimetres and 1/64 px, which Pose2Sim converts. It has no k3."""
    root = ElementTree.Element("calibration", {"source": "psfs convert", "type": "regular"})
    cameras = ElementTree.SubElement(root, "cameras")
    for camera in rig:
        if camera.distortion[4]:
            raise InputError(f"camera {camera.name} has k3; expected none, for Qualisys has no k3")
        attributes = {"active": "1", "avg-residual": "0", "model": "none", "serial": camera.name}
        element = ElementTree.SubElement(cameras, "camera", {**attributes, "viewrotation": "0"})
        width, height = camera.size
        field = {"left": 0, "top": 0, "right": width - 1, "bottom": height - 1}
        for tag in ("fov_marker", "fov_video"):
            ElementTree.SubElement(element, tag, {key: str(n) for key, n in field.items()})
        turn = TO_OPENCV @ camera.R
        placed = [*turn.ravel(), *(1000 * camera.centre)]
        _add_numbers(element, "transform", dict(zip([*MATRIX, *"xyz"], placed, strict=True)))
        K, (k1, k2, p1, p2, _) = SUBPIXELS * camera.K, camera.distortion
        lens = {"focalLengthU": K[0, 0], "focalLengthV": K[1, 1]}
        lens |= {"centerPointU": K[0, 2], "centerPointV": K[1, 2], "skew": 0.0}
        lens |= {"radialDistortion1": k1, "radialDistortion2": k2, "radialDistortion3": 0.0}
        lens |= {"tangentalDistortion1": p1, "tangentalDistortion2": p2}
        _add_numbers(element, "intrinsic", lens)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    write_text(folder / "Calib.qca.txt", f"<?xml version='1.0' encoding='ASCII'?>\n{text}\n")
    return folder / "Calib.qca.txt"


def _add_numbers(element: ElementTree.Element, tag: str, values: Mapping[str, float]) -> None:
    ElementTree.SubElement(element, tag, {key: repr(float(v)) for key, v in values.items()})


def _words(values: list[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


#: The formats that are written, by the names that `psfs convert --to` takes.
WRITERS: Mapping[str, Callable[[Path, CameraRig], Path]] = {
    "caliscope": write_caliscope,
    "colmap": write_colmap,
    "easymocap": write_easymocap,
    "opencv": write_opencv,
    "panoptic": write_panoptic,
    "qualisys": write_qualisys,
}


def write_calibration(folder: Path, rig: CameraRig, kind: str) -> Path:
    """Write the rig as the program `kind`, one of `WRITERS`, has it; return the file or folder.

    Raises InputError for lenses that the format cannot say.
    """
    other: list[Camera] = [camera for camera in rig if camera.kappa or camera.fisheye]
    if other:
        lens = "Tsai's distortion" if other[0].kappa else "a fisheye lens"
        raise InputError(
            f"camera {other[0].name} has {lens}; expected OpenCV's k1 k2 p1 p2 k3, for {kind} has "
            "no other"
        )
    return WRITERS[kind](folder, rig)

"""OpenCV FileStorage (xml, yml, json): one file per camera, or EasyMocap's intri.yml + extri.yml.

x_cam = R X + T, the rotation as a matrix or a Rodrigues vector.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cl import InputError
from psfs.cameras.calibration.common import (
    Size,
    Sizes,
    array,
    in_metres,
    naming,
    read_text,
    rotation_matrix,
    sizes_for,
)
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.names import listed, natural_key
from psfs.cameras.units import Unit

_K = ("CameraMatrix", "camera_matrix", "Camera_Matrix", "cameraMatrix", "M1", "M", "K")
_DISTORTION = (
    "DistortionCoeffs",
    "distortion_coefficients",
    "Distortion_Coefficients",
    "distCoeffs",
    "dist_coeffs",
    "D1",
    "D",
    "dist",
)
_ROTATION = ("R", "Rot", "Rotation", "rotation", "rotation_matrix", "rvec", "rotation_vector")
_TRANSLATION = ("T", "t", "Translation", "translation", "tvec", "translation_vector")
_WIDTH, _HEIGHT = (
    ("image_width", "image_Width", "width"),
    ("image_height", "image_Height", "height"),
)


class Storage:
    """An open FileStorage. `matrix(names)` looks a matrix up under several names."""

    def __init__(self, path: Path) -> None:
        read_text(path)  # for the error of a missing or binary file; OpenCV does not say
        try:
            self._storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        except (cv2.error, SystemError):
            raise InputError("malformed; expected an OpenCV FileStorage file") from None
        if not self._storage.isOpened():
            raise InputError("cannot be opened; expected an OpenCV FileStorage file")
        self.keys: list[str] = list(self._storage.root().keys())

    def _node(self, names: Sequence[str]) -> Any:
        return next((self._storage.getNode(name) for name in names if name in self.keys), None)

    def matrix(self, names: Sequence[str]) -> np.ndarray:
        """Return the first of `names` that is there, float64. Raises InputError when none is."""
        node = self._node(names)
        if node is None:
            raise InputError(f"no {names[0]} among {listed(self.keys)}; expected one of {names}")
        if not node.isMap():
            return np.array([node.at(i).real() for i in range(node.size())])
        return np.asarray(node.mat(), np.float64)

    def strings(self, name: str) -> list[str]:
        node = self._node([name])
        return [] if node is None else [node.at(i).string() for i in range(node.size())]

    def number(self, names: Sequence[str]) -> float | None:
        node = self._node(names)
        return None if node is None else node.real()


def read_filestorage(
    paths: Sequence[Path],
    unit: Unit | None = None,
    sizes: Sizes = None,
    names: Sequence[str] | None = None,
) -> CameraRig:
    """Read one camera per path, named after its file or by `names`. The format has no unit: metres
    unless `unit` says otherwise. Sizes come from image_width, image_height where present."""
    names = list(names or [path.stem for path in paths])
    cameras = []
    for index, (name, path) in enumerate(zip(names, paths, strict=True)):
        with naming(path):
            storage = Storage(path)
            width, height = storage.number(_WIDTH), storage.number(_HEIGHT)
            size = (int(width), int(height)) if width and height else None
            cameras.append(_camera(storage, name, size or sizes_for(names, sizes)[index]))
    return in_metres(CameraRig(tuple(cameras)), unit, default="m")


def _camera(storage: Storage, name: str, size: Size) -> Camera:
    return Camera(
        name=name,
        K=array(storage.matrix(_K), 9, f"camera {name}: camera matrix"),
        distortion=storage.matrix(_DISTORTION),
        R=rotation_matrix(storage.matrix(_ROTATION), f"camera {name}: rotation"),
        t=array(storage.matrix(_TRANSLATION), 3, f"camera {name}: translation"),
        size=size,
    )


def read_easymocap(folder: Path, unit: Unit | None = None, sizes: Sizes = None) -> CameraRig:
    """Read EasyMocap's intri.yml (K_n, dist_n) and extri.yml (R_n Rodrigues, Rot_n, T_n); metres
    unless `unit` says otherwise."""
    with naming(folder / "intri.yml"):
        intrinsic = Storage(folder / "intri.yml")
        names = intrinsic.strings("names")
        if not names:
            raise InputError("no list `names`; expected EasyMocap's camera names")
    with naming(folder / "extri.yml"):
        extrinsic = Storage(folder / "extri.yml")
    names.sort(key=natural_key)
    cameras = []
    for index, name in enumerate(names):
        with naming(folder / "intri.yml"):
            K = array(intrinsic.matrix([f"K_{name}"]), 9, f"camera {name}: K")
            distortion = intrinsic.matrix([f"dist_{name}", f"D_{name}"])
            width, height = intrinsic.number([f"W_{name}"]), intrinsic.number([f"H_{name}"])
            size = (int(width), int(height)) if width and height else None
            size = size or sizes_for(names, sizes)[index]
        with naming(folder / "extri.yml"):
            R = rotation_matrix(extrinsic.matrix([f"Rot_{name}", f"R_{name}"]), f"camera {name}")
            t = array(extrinsic.matrix([f"T_{name}"]), 3, f"camera {name}: T")
            cameras.append(Camera(name, K, distortion, R, t, size))
    return in_metres(CameraRig(tuple(cameras)), unit, default="m")

"""Read OpenCV FileStorage (xml, yml, json): one file per camera, or EasyMocap's intri.yml +
extri.yml.

x_cam = R X + T, the rotation as a matrix or a Rodrigues vector.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cl import InputError
from psfs.cameras.calibration.common import (
    Calibration,
    Size,
    Sizes,
    check_whole_size,
    convert_to_metres,
    find_sizes,
    name_file_in_errors,
    parse_array,
    parse_rotation,
    read_text,
)
from psfs.cameras.camera import MOST_CAMERAS, Camera, CameraRig
from psfs.cameras.names import join_names, natural_key
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
_ROTATION = (
    *("R", "Rot", "Rotation", "rotation", "rotation_matrix", "rvec", "rotation_vector"),
    *("RotationValues", "RotationVector"),
)
_TRANSLATION = (
    *("T", "t", "Translation", "translation", "tvec", "translation_vector"),
    *("TranslationValues", "TranslationVector"),
)
_WIDTH, _HEIGHT = (
    ("image_width", "image_Width", "width"),
    ("image_height", "image_Height", "height"),
)


#: Most levels of brackets or tags; OpenCV crashes on thousands, and a calibration has four.
_DEEPEST = 32
_MOST_ITEMS = 64


def check_nesting(text: str, suffix: str) -> None:
    """Raise InputError for a text that is nested too deeply to be parsed safely."""
    if suffix == ".xml":
        tags = re.findall(r"<([/?!]?)[^<>]*?(/?)>", text)
        steps = [{"/": -1, "": 0 if closed else 1}.get(kind, 0) for kind, closed in tags]
    else:
        steps = [1 if c in "[{" else -1 for c in re.findall(r"[][{}]", text)]
    indented = max((len(line) - len(line.lstrip(" -\t")) for line in text.splitlines()), default=0)
    if max(accumulate(steps), default=0) > _DEEPEST or indented > 8 * _DEEPEST:
        raise InputError(f"nested more than {_DEEPEST} levels deep; expected a calibration")


class Storage:
    """An open FileStorage file whose values are looked up under alternative names."""

    def __init__(self, path: Path) -> None:
        text = read_text(path)
        check_nesting(text, path.suffix.lower())
        try:
            # From memory: OpenCV crashes on a file name that is not UTF-8.
            self._storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
            opened = self._storage.isOpened() and self._storage.root().isMap()
            self.keys: list[str] = list(self._storage.root().keys()) if opened else []
        except (cv2.error, SystemError, ValueError):
            raise InputError("malformed; expected an OpenCV FileStorage file") from None
        if not opened:
            raise InputError("cannot be opened; expected an OpenCV FileStorage file")

    def _node(self, names: Sequence[str]) -> Any:
        return next((self._storage.getNode(name) for name in names if name in self.keys), None)

    def matrix(self, names: Sequence[str]) -> np.ndarray:
        """Return the matrix under the first of `names` that exists, float64. Raises InputError if
        none does."""
        node = self._node(names)
        if node is None:
            raise InputError(
                f"no {names[0]} among {join_names(self.keys)}; expected one of {names}"
            )
        what = f"the value of {names[0]}"
        if not node.isMap():
            return _read_numbers(node, what)
        # Not by `node.mat()`, which allocates what a damaged file claims, and then crashes.
        rows, columns = (_read_numbers(node.getNode(key), what) for key in ("rows", "cols"))
        values = _read_numbers(node.getNode("data"), what)
        if rows.size != 1 or columns.size != 1 or rows[0] * columns[0] != values.size:
            raise InputError(
                f"{what} has {values.size} numbers in {join_names(map(str, rows))} rows of "
                f"{join_names(map(str, columns))}; expected a matrix"
            )
        return values.reshape(int(rows[0]), int(columns[0]))

    def read_all(self) -> dict[str, Any]:
        """Return everything in the file as tables, lists, numbers and texts; matrices as arrays."""
        root = self._storage.root()
        return {key: _read_node(root.getNode(key)) for key in self.keys}

    def strings(self, name: str) -> list[str]:
        node = self._node([name])
        items = [] if node is None else [node.at(i) for i in range(node.size())]
        if len(items) > MOST_CAMERAS or not all(item.isString() for item in items):
            raise InputError(f"{name} is not a list of at most {MOST_CAMERAS} texts")
        return [item.string() for item in items]

    def number(self, names: Sequence[str]) -> float | None:
        node = self._node(names)
        if node is None:
            return None
        if not (node.isReal() or node.isInt()):
            raise InputError(f"{names[0]} is not a number; expected pixels")
        return float(parse_array(node.real(), 1, names[0])[0])


def _read_node(node: Any) -> Any:
    if node.isMap():
        keys = node.keys()
        if {"dt", "data"} <= set(keys):
            return _read_numbers(node.getNode("data"), "a matrix")
        return {key: _read_node(node.getNode(key)) for key in keys}
    if node.isSeq():
        return [_read_node(node.at(i)) for i in range(min(node.size(), _MOST_ITEMS))]
    return node.string() if node.isString() else int(node.real()) if node.isInt() else node.real()


def _read_numbers(node: Any, what: str) -> np.ndarray:
    """Return the numbers (N,) of a node, float64. Raises InputError."""
    if node.isSeq():
        items = [node.at(i) for i in range(min(node.size(), _MOST_ITEMS + 1))]
    else:
        items = [node]
    if len(items) > _MOST_ITEMS or not all(item.isReal() or item.isInt() for item in items):
        raise InputError(
            f"{what} is not a list of numbers, up to {_MOST_ITEMS} of them; expected a matrix"
        )
    return parse_array([item.real() for item in items], None, what)


def read_filestorage(
    paths: Sequence[Path],
    unit: Unit | None,
    sizes: Sizes,
    names: Sequence[str] | None = None,
) -> Calibration:
    """Read one camera per path, named after its file or by `names`.

    The format states no unit: metres unless `unit` says otherwise. Sizes come from image_width and
    image_height where present, else from `sizes`.
    """
    names = list(names or [path.stem for path in paths])
    cameras = []
    for index, (name, path) in enumerate(zip(names, paths, strict=True)):
        with name_file_in_errors(path):
            storage = Storage(path)
            width, height = storage.number(_WIDTH), storage.number(_HEIGHT)
            size = (
                check_whole_size(width, height, "the picture's size") if width and height else None
            )
            cameras.append(_camera(storage, name, size or find_sizes(names, sizes)[index]))
    return convert_to_metres(CameraRig(tuple(cameras)), unit, default="m")


def _camera(storage: Storage, name: str, size: Size) -> Camera:
    return Camera(
        name=name,
        K=parse_array(storage.matrix(_K), 9, f"camera {name}: camera matrix"),
        distortion=storage.matrix(_DISTORTION),
        R=parse_rotation(storage.matrix(_ROTATION), f"camera {name}: rotation"),
        t=parse_array(storage.matrix(_TRANSLATION), 3, f"camera {name}: translation"),
        size=size,
    )


def read_easymocap(folder: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read EasyMocap's intri.yml (K_n, dist_n) and extri.yml (R_n Rodrigues, Rot_n, T_n).

    Metres unless `unit` says otherwise.
    """
    with name_file_in_errors(folder / "intri.yml"):
        intrinsic = Storage(folder / "intri.yml")
        names = intrinsic.strings("names")
        if not names:
            raise InputError("no list `names`; expected EasyMocap's camera names")
    with name_file_in_errors(folder / "extri.yml"):
        extrinsic = Storage(folder / "extri.yml")
    names.sort(key=natural_key)
    cameras = []
    for index, name in enumerate(names):
        with name_file_in_errors(folder / "intri.yml"):
            K = parse_array(intrinsic.matrix([f"K_{name}"]), 9, f"camera {name}: K")
            distortion = intrinsic.matrix([f"dist_{name}", f"D_{name}"])
            width, height = intrinsic.number([f"W_{name}"]), intrinsic.number([f"H_{name}"])
            size = check_whole_size(width, height, f"camera {name}") if width and height else None
            size = size or find_sizes(names, sizes)[index]
        with name_file_in_errors(folder / "extri.yml"):
            R = parse_rotation(extrinsic.matrix([f"Rot_{name}", f"R_{name}"]), f"camera {name}")
            t = parse_array(extrinsic.matrix([f"T_{name}"]), 3, f"camera {name}: T")
            cameras.append(Camera(name, K, distortion, R, t, size))
    return convert_to_metres(CameraRig(tuple(cameras)), unit, default="m")

"""Read OpenCV FileStorage (xml, yml, json): one file per camera, or EasyMocap's intri.yml +
extri.yml.

x_cam = R X + T, the rotation as a matrix or a Rodrigues vector.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cl import InputError
from psfs.cameras.calibration.common import (
    MOST_NUMBERS,
    PLAIN,
    Calibration,
    Sizes,
    build,
    name_file_in_errors,
    read_files,
    read_text,
)
from psfs.cameras.camera import MOST_CAMERAS
from psfs.cameras.names import join_names, natural_key
from psfs.cameras.units import Unit

#: Names of the parts of a camera in programs' files.
_NAMES = {
    "K": ("CameraMatrix", "camera_matrix", "Camera_Matrix", "cameraMatrix", "M1", "M", "K"),
    "distortion": (
        *("DistortionCoeffs", "distortion_coefficients", "Distortion_Coefficients"),
        *("distCoeffs", "dist_coeffs", "D1", "D", "dist"),
    ),
    "R": (
        *("R", "Rot", "Rotation", "rotation", "rotation_matrix", "rvec", "rotation_vector"),
        *("RotationValues", "RotationVector"),
    ),
    "t": (
        *("T", "t", "Translation", "translation", "tvec", "translation_vector"),
        *("TranslationValues", "TranslationVector"),
    ),
    "width": ("image_width", "image_Width", "width"),
    "height": ("image_height", "image_Height", "height"),
}
_SIZE = ("width", "height")
_LAYOUT = replace(PLAIN, size=_SIZE)
#: Most levels of brackets or tags; OpenCV crashes on thousands, and a calibration has four.
_DEEPEST = 32


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


def read_storage(path: Path) -> dict[str, Any]:
    """Return what a file holds as tables, lists, numbers, texts, and arrays for matrices. Raises
    InputError for any but FileStorage's files."""
    text = read_text(path)
    with name_file_in_errors(path):
        check_nesting(text, path.suffix.lower())
        try:
            # From memory: OpenCV crashes on a file name that is not UTF-8.
            storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
            root = storage.root()
            opened = storage.isOpened() and root.isMap()
            keys = root.keys() if opened else []
        except (cv2.error, SystemError, ValueError):
            raise InputError("malformed; expected an OpenCV FileStorage file") from None
        if not opened:
            raise InputError("cannot be opened; expected an OpenCV FileStorage file")
        return {key: _read_node(root.getNode(key)) for key in keys}


def _read_node(node: Any) -> Any:
    if node.isMap():
        keys = node.keys()
        if {"dt", "data"} <= set(keys):
            # Not by `node.mat()`, which allocates what a damaged file claims, and then crashes.
            return _read_numbers(node.getNode("data"))
        return {key: _read_node(node.getNode(key)) for key in keys}
    if node.isSeq():
        return [_read_node(node.at(i)) for i in range(min(node.size(), MOST_CAMERAS))]
    return node.string() if node.isString() else int(node.real()) if node.isInt() else node.real()


def _read_numbers(node: Any) -> np.ndarray:
    """Return the numbers (N,) of a matrix, float64. Raises InputError."""
    count = node.size() if node.isSeq() else 0
    items = [node.at(i) for i in range(min(count, MOST_NUMBERS + 1))]
    if not 0 < count <= MOST_NUMBERS or not all(item.isReal() or item.isInt() for item in items):
        raise InputError(
            f"the data of a matrix is not a list of numbers; expected up to {MOST_NUMBERS} of them"
        )
    return np.array([item.real() for item in items], float)


def _choose_values(
    content: Mapping[str, Any], names: Mapping[str, Sequence[str]]
) -> dict[str, Any]:
    """Return the first value by each part's `names` that there is; sizes may be absent. Raises
    InputError."""
    record = {}
    for part, choices in names.items():
        name = next((name for name in choices if name in content), None)
        if name is not None:
            record[part] = content[name]
        elif part not in _SIZE:
            raise InputError(
                f"no {choices[0]} among {join_names(content)}; expected one of "
                f"{join_names(choices)}"
            )
    return record


def read_filestorage(
    paths: Sequence[Path], unit: Unit | None, sizes: Sizes, names: Sequence[str] | None = None
) -> Calibration:
    """Read one camera per path, named after its file or by `names`.

    The format states no unit: metres unless `unit` says otherwise. Sizes come from image_width and
    image_height where present, else from `sizes`.
    """
    return read_files(
        paths, lambda path: _choose_values(read_storage(path), _NAMES), _LAYOUT, unit, sizes, names
    )


def read_easymocap(folder: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read EasyMocap's intri.yml (K_n, dist_n) and extri.yml (R_n Rodrigues, Rot_n, T_n).

    Metres unless `unit` says otherwise.
    """
    content = read_storage(folder / "extri.yml") | read_storage(folder / "intri.yml")
    names = content.get("names")
    with name_file_in_errors(folder / "intri.yml"):
        if not names or not all(isinstance(name, str) for name in names):
            raise InputError("no list `names`; expected EasyMocap's camera names")
    with name_file_in_errors(folder):
        records = []
        for name in sorted(names, key=natural_key):
            keys = {
                "K": [f"K_{name}"],
                "distortion": [f"dist_{name}", f"D_{name}"],
                "R": [f"Rot_{name}", f"R_{name}"],
                "t": [f"T_{name}"],
                "width": [f"W_{name}"],
                "height": [f"H_{name}"],
            }
            records.append((name, _choose_values(content, keys)))
        return build(_LAYOUT, records, unit, sizes)

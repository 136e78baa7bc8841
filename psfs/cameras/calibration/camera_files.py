"""Read text files of numbers, one per camera or per image (`.txt`, `.pa`, `.krt`, `.krtd`, `.cam`).

A file holds K (9), R (9), t (3) and optionally the distortion; or K (9) and [R | t] (3x4 or 4x4);
or a projection matrix (3x4). Leading words (`CONTOUR`) and comments after `#` are ignored.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cl import InputError
from psfs.cameras.calibration.common import (
    Calibration,
    Size,
    Sizes,
    build_rig_of_files,
    name_file_in_errors,
    parse_numbers,
    parse_rotation,
    read_text,
)
from psfs.cameras.calibration.projections import decompose_projection, mirror_if_facing_away
from psfs.cameras.camera import Camera
from psfs.cameras.units import Unit

SUFFIXES = (".pa", ".krt", ".krtd", ".cam", ".txt", ".p")
_WANTED = "expected K R t (21 numbers), K and [R | t] (21 or 25), or a 3x4 matrix (12)"


def read_camera_files(paths: Sequence[Path], unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read one camera per path, named after the file. Metres unless `unit` says otherwise."""
    values = {path: _read_numbers(path) for path in paths}

    def camera(path: Path, size: Size) -> Camera:
        return build_camera(path.stem, values[path], size)

    rig = build_rig_of_files(paths, sizes, camera, unit, default="m")
    matrices = all(own.size == 12 for own in values.values())
    return mirror_if_facing_away(rig) if matrices else rig


def build_camera(name: str, values: np.ndarray, size: Size) -> Camera:
    """Build a camera from 12, 21, 25 or more numbers. Raises InputError for other counts."""
    count = values.size
    if count == 12:
        return decompose_projection(name, values.reshape(3, 4), size)
    if count not in (21, 25) and not 23 <= count <= 21 + 14:
        raise InputError(f"{count} numbers; {_WANTED}")
    K, rest = values[:9].reshape(3, 3), values[9:]
    if abs(K[2]).max() == 0:
        raise InputError(f"camera {name}: the last row of K is zero; {_WANTED}")
    distortion = np.zeros(0)
    if count == 25 and np.allclose(rest[12:], [0, 0, 0, 1]):
        joint = rest[:12].reshape(3, 4)
    elif count == 21 and _is_rotation(rest.reshape(3, 4)[:, :3]):
        joint = rest.reshape(3, 4)
    else:
        joint = np.column_stack([rest[:9].reshape(3, 3), rest[9:12]])
        distortion = rest[12:]
    R = parse_rotation(joint[:, :3], f"camera {name}: R")
    return Camera(name, K / K[2, 2], distortion, R, joint[:, 3], size)


def _is_rotation(R: np.ndarray) -> bool:
    return bool(np.abs(R @ R.T - np.eye(3)).max() < 1e-3)


def _read_numbers(path: Path) -> np.ndarray:
    """Read all numbers (N,) of a file."""
    lines = [line.split("#")[0].replace(",", " ").split() for line in read_text(path).splitlines()]
    words = [word.strip("[];") for line in lines for word in line]
    while words and not _is_number(words[0]):
        words.pop(0)
    with name_file_in_errors(path):
        return parse_numbers([word for word in words if word], "a camera")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True

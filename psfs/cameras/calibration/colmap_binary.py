"""Read COLMAP's binary model, `cameras.bin` and `images.bin`, into the words of its text files."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import IO, Any

from cl import InputError
from psfs.cameras.camera import MOST_CAMERAS
from psfs.common.reading import open_input, parsing

#: Names and numbers of parameters of the models, by their ids.
_MODELS = {
    0: ("SIMPLE_PINHOLE", 3), 1: ("PINHOLE", 4), 2: ("SIMPLE_RADIAL", 4), 3: ("RADIAL", 5),
    4: ("OPENCV", 8), 5: ("OPENCV_FISHEYE", 8), 6: ("FULL_OPENCV", 12), 7: ("FOV", 5),
    8: ("SIMPLE_RADIAL_FISHEYE", 4), 9: ("RADIAL_FISHEYE", 5), 10: ("THIN_PRISM_FISHEYE", 12),
}  # fmt: skip
_WHAT = "COLMAP's binary model"
#: Longest name of an image, bytes; most points in one, of 24 bytes each.
_LONGEST, _MOST_POINTS = 1024, 10_000_000


def read_binary_cameras(path: Path) -> list[list[str]]:
    """Return ID, model, width, height and parameters of each camera. Raises InputError."""
    with open_input(path, _WHAT) as file, parsing(path, _WHAT):
        found = []
        for _ in range(_read_count(file, path)):
            number, model, width, height = _unpack(file, "<iiQQ", path)
            if model not in _MODELS:
                raise InputError(f"{path}: camera {number} has model {model}; expected 0 to 10")
            name, count = _MODELS[model]
            values = _unpack(file, f"<{count}d", path)
            found.append([str(number), name, str(width), str(height), *map(repr, values)])
        return found


def read_binary_images(path: Path) -> list[list[str]]:
    """Return ID, quaternion, translation, camera ID and name of each image. Raises InputError."""
    with open_input(path, _WHAT) as file, parsing(path, _WHAT):
        found = []
        for _ in range(_read_count(file, path)):
            number, *pose, camera = _unpack(file, "<i7di", path)
            name = bytearray()
            while (letter := file.read(1)) not in (b"\0", b"") and len(name) <= _LONGEST:
                name += letter
            (points,) = _unpack(file, "<Q", path)
            if points > _MOST_POINTS or len(name) > _LONGEST:
                raise InputError(f"{path}: image {number} is damaged; expected {_WHAT}")
            file.seek(24 * points, 1)
            found.append([str(number), *map(repr, pose), str(camera), name.decode("utf-8")])
        return found


def _read_count(file: IO[bytes], path: Path) -> int:
    (count,) = _unpack(file, "<Q", path)
    if count > MOST_CAMERAS:
        raise InputError(f"{path}: {count} entries; expected at most {MOST_CAMERAS} in {_WHAT}")
    return int(count)


def _unpack(file: IO[bytes], layout: str, path: Path) -> tuple[Any, ...]:
    size = struct.calcsize(layout)
    content = file.read(size)
    if len(content) < size:
        raise InputError(f"{path}: ends in the middle of an entry; expected {_WHAT}")
    return struct.unpack(layout, content)

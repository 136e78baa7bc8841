"""Read pictures; what their headers claim is checked before they are decoded."""

from __future__ import annotations

import io
import os
import warnings
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, UnidentifiedImageError

from cl import InputError
from psfs.common.picture_size import check_picture_size
from psfs.common.reading import open_input, parsing

#: Largest picture file.
_MOST_BYTES = 2**30


def read_picture(path: Path, flags: int = cv2.IMREAD_COLOR) -> np.ndarray:
    """Read an image file to (h, w, 3) uint8 BGR, or as the `flags` of cv2.imdecode say.

    Raises InputError naming the file if it is not an image, too large, or truncated;
    MissingFileError if it is absent.
    """
    content = _read_bytes(path)
    _check_header(path, content)
    try:
        picture = cv2.imdecode(content, flags | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:
        picture = None
    if picture is None:
        raise InputError(f"{path}: cannot be decoded; expected an image")
    return picture


def _read_bytes(path: Path) -> np.ndarray:
    with parsing(path, "an image"), open_input(path, "an image") as file:
        if os.fstat(file.fileno()).st_size > _MOST_BYTES:
            raise InputError(f"{path}: more than {_MOST_BYTES // 2**20} MiB; expected an image")
        return np.fromfile(file, np.uint8)


def _check_header(path: Path, content: np.ndarray) -> None:
    """Raise InputError if the picture is too large, or a truncated JPEG, PNG or BMP.

    OpenCV would fill the missing part with grey.
    """
    try:
        with warnings.catch_warnings(), Image.open(io.BytesIO(content.data)) as picture:
            warnings.simplefilter("ignore")
            size, kind = picture.size, picture.format
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        raise InputError(f"{path}: cannot be decoded; expected an image") from None
    check_picture_size(size, f"{path}: claims")
    data = content.tobytes()
    whole = True
    if kind == "JPEG":
        whole = data.find(b"\xff\xd9", _find_scan(data)) > 0
    elif kind == "PNG":
        whole = b"IEND" in data[-64 * 1024 :]
    elif kind == "BMP" and data[:2] == b"BM":
        whole = len(data) >= int.from_bytes(data[2:6], "little")
    if not whole:
        raise InputError(f"{path}: ends early; expected a whole {kind} image")


def _find_scan(data: bytes) -> int:
    """Return where the compressed picture of a JPEG begins.

    The headers before it may hold a small picture of their own.
    """
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
        if data[at + 1] == 0xFF:
            at += 1
            continue
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return at

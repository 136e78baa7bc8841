"""Read pictures, of which what their headers claim is checked before they are decoded, and resize
them."""

from __future__ import annotations

import io
import os
import warnings
from pathlib import Path

import cv2
import numpy as np

# suppresses FFmpeg's messages; we raise errors ourselves
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

from cl import InputError
from psfs.common.ranges import MOST_PIXELS, check_picture_size
from psfs.common.reading import open_input, parsing

if hasattr(cv2, "setLogLevel"):  # OpenCV 4
    cv2.setLogLevel(0)
else:
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)

#: Largest picture file: uncompressed, of four bytes a pixel.
_MOST_BYTES = 4 * MOST_PIXELS


def read_picture(path: Path, flags: int = cv2.IMREAD_COLOR) -> np.ndarray:
    """Read an image file to (h, w, 3) uint8 BGR, turned as its EXIF says (as videos are by theirs),
    or as the `flags` of cv2.imdecode say.

    Raises InputError naming the file if it is not an image, too large, or truncated;
    MissingFileError if it is absent.
    """
    content = _read_bytes(path)
    _check_header(path, content)
    try:
        picture = cv2.imdecode(content, flags)
    except cv2.error:
        picture = None
    if picture is None:
        raise InputError(f"{path}: cannot be decoded; expected an image")
    return picture


def read_mask(path: Path) -> np.ndarray:
    """Read a mask to (h, w, 3) uint8, bright where the person is.

    The mask is the alpha channel where there is one that is not constant, else the brightest
    channel. Values of 16 bits that fit into 8 are taken as they are; where none is above 1, 1 is
    the person. Raises InputError as `read_picture` does, and for another depth.
    """
    picture = read_picture(path, cv2.IMREAD_UNCHANGED)
    channels = picture.reshape(*picture.shape[:2], -1)
    if channels.shape[2] in (2, 4):
        alpha = channels[..., -1:]
        channels = alpha if np.ptp(alpha) > 0 else channels[..., :-1]
    grey = channels.max(axis=-1, keepdims=True)
    if grey.min() >= 0 and grey.max() <= 1:
        grey = np.rint(255.0 * grey)
    elif grey.dtype == np.uint16:
        grey = grey if grey.max() < 256 else grey >> 8
    elif grey.dtype != np.uint8:
        raise InputError(f"{path}: a mask of {grey.dtype}; expected 8 or 16 bits, or 0 to 1")
    return np.repeat(grey.astype(np.uint8), 3, axis=-1)


def _read_bytes(path: Path) -> np.ndarray:
    with parsing(path, "an image"), open_input(path, "an image") as file:
        if os.fstat(file.fileno()).st_size > _MOST_BYTES:
            raise InputError(f"{path}: more than {_MOST_BYTES // 2**20} MiB; expected an image")
        return np.fromfile(file, np.uint8)


def _check_header(path: Path, content: np.ndarray) -> None:
    """Raise InputError if the picture is too large, or a truncated JPEG, PNG or BMP.

    OpenCV would fill the missing part with grey.
    """
    from PIL import Image  # takes a while to load

    try:
        with warnings.catch_warnings(), Image.open(io.BytesIO(content.data)) as picture:
            warnings.simplefilter("ignore")
            size, kind = picture.size, picture.format
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
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


def scale_picture(picture: np.ndarray, factor: float) -> np.ndarray:
    """Return a picture (H, W, ...) resized by `factor`, at most 1: the mean over each pixel's area,
    as the camera `scaled(factor)` shows it.

    The small sides are rounded, the scale is not: stated sizes would make cv2.resize stretch it.
    """
    return cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)

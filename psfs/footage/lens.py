"""Focal lengths that pictures and videos state in their metadata.

Pictures: EXIF. Videos: QuickTime's keys as iPhones write them, of the file or of its video track,
which FFmpeg does not read. Other phones' videos state none; GoPro's GPMF describes a fisheye lens,
which a focal length does not.
"""

from __future__ import annotations

import io
import math
import re
import struct
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from psfs.common.numbers import INCH
from psfs.common.reading import open_input
from psfs.footage.media import IMAGE_SUFFIXES

#: Sides of 35 mm film, mm.
_FILM = 36.0, 24.0
#: Suffixes of files with QuickTime's atoms.
_ATOM_SUFFIXES = {".mp4", ".mov", ".m4v"}
#: Atoms that hold atoms, their greatest depth, and the most bytes of `moov`, which holds them all.
_NESTING, _DEPTH, _MOST_BYTES = ("trak", "udta", "meta"), 4, 2**26
_EQUIVALENT = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
#: EXIF: its own table, and there the focal length, mm, that of 35 mm film, the pixels per unit of
#: the sensor, that unit, and the picture's sides, px.
_EXIF, _FOCAL, _FOCAL_35 = 0x8769, 0x920A, 0xA405
_DENSITY, _DENSITY_UNIT, _SIDES = 0xA20E, 0xA210, (0xA002, 0xA003)
#: Units of the density, mm.
_UNITS = {2: 1000 * INCH, 3: 10.0, 4: 1.0}
#: Focal lengths outside are mistakes, as shares of the longer side: 150 and 5 degrees.
_LEAST, _MOST = 0.13, 11.5


@dataclass(frozen=True)
class StatedLens:
    """A focal length from metadata.

    share: focal length as a share of the picture's longer side. source: what the file says.
    """

    share: float
    source: str

    @property
    def degrees(self) -> float:
        """Angle of view of the longer side."""
        return 2 * math.degrees(math.atan(0.5 / self.share))


def read_lens(path: Path) -> StatedLens | None:
    """Return the lens that a picture's or a video's metadata state; None if they state none.

    Raises InputError if the file cannot be read.
    """
    suffix, found = path.suffix.lower(), None
    if suffix in IMAGE_SUFFIXES:
        found = _read_picture(path)
    elif suffix in _ATOM_SUFFIXES:
        found = _read_video(path)
    return found if found is not None and _LEAST < found.share < _MOST else None


def share_of_equivalent(mm: float, width: float, height: float) -> float:
    """Return the focal length as a share of a picture's longer side from that of 35 mm film.

    Equal diagonals, as EXIF defines it, for pictures up to 3:2; wider ones are cut from a frame of
    that width, so that the longer sides are equal.
    """
    longer, shorter = max(width, height), min(width, height)
    if longer <= 1.5 * shorter:
        return mm / math.hypot(*_FILM) * math.hypot(longer, shorter) / longer
    return mm / _FILM[0]


def _read_picture(path: Path) -> StatedLens | None:
    size, tags = _read_exif(path)
    equivalent = _positive(tags.get(_FOCAL_35))
    if equivalent:
        return StatedLens(share_of_equivalent(equivalent, *size), f"EXIF: {equivalent:g} mm of 35")
    focal, density = _positive(tags.get(_FOCAL)), _positive(tags.get(_DENSITY))
    longer = max(_positive(tags.get(side)) for side in _SIDES)
    unit = _UNITS.get(tags.get(_DENSITY_UNIT, 2))
    if focal and density and longer and unit:
        source = f"EXIF: {focal:g} mm, {density / unit:.0f} px per mm"
        return StatedLens(focal * density / unit / longer, source)
    return None


def _read_exif(path: Path) -> tuple[tuple[int, int], dict[int, Any]]:
    """Return a picture's size and the tags of its EXIF table, none if it cannot be read."""
    from PIL import Image  # takes a while to load

    with open_input(path, "a picture") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with Image.open(file) as picture:
                return picture.size, picture.getexif().get_ifd(_EXIF)
        except Exception:  # Pillow raises almost anything; who decodes the picture says what it is
            return (1, 1), {}


def _positive(value: Any) -> float:
    """Return a number of EXIF; 0 if there is none, or not a positive one."""
    try:
        number = float(value)
    except (TypeError, ValueError, ArithmeticError):
        return 0.0
    return number if 0 < number < math.inf else 0.0


def _read_video(path: Path) -> StatedLens | None:
    with open_input(path, "a video") as file:
        movie = _find_movie(file)
    for key, text in _read_keys(movie):
        number = re.match(r"\s*(\d+(?:\.\d+)?)", text)
        if key == _EQUIVALENT and number and float(number[1]) > 0:
            mm = float(number[1])
            return StatedLens(mm / _FILM[0], f"QuickTime: {mm:g} mm of 35")
    return None


def _find_movie(file: IO[bytes]) -> bytes:
    """Return the content of a file's atom `moov`; nothing without one."""
    while len(head := file.read(8)) == 8:
        size, kind = struct.unpack(">I4s", head)
        rest = size - 8
        if size == 1:
            rest = struct.unpack(">Q", file.read(8).rjust(8, b"\0"))[0] - 16
        if kind == b"moov" or size == 0:
            return file.read(min(max(0, rest), _MOST_BYTES)) if kind == b"moov" else b""
        if rest < 0 or rest >= 2**62:
            return b""
        file.seek(rest, io.SEEK_CUR)
    return b""


def _atoms(content: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield kind and content of the atoms in a row."""
    at = 0
    while at + 8 <= len(content):
        size, kind = struct.unpack_from(">I4s", content, at)
        if size < 8:
            return
        yield kind.decode("latin1"), content[at + 8 : at + size]
        at += size


def _read_keys(content: bytes, depth: int = 0) -> Iterator[tuple[str, str]]:
    """Yield keys and values of all tables of metadata inside atoms, tracks' as well."""
    keys: list[str] = []
    for kind, inside in _atoms(content):
        if kind in _NESTING and depth < _DEPTH:
            # In MP4 a version precedes the atoms of `meta`.
            skip = 4 if kind == "meta" and inside[4:8] != b"hdlr" else 0
            yield from _read_keys(inside[skip:], depth + 1)
        elif kind == "keys":
            keys = [name.decode("latin1") for _, name in _atoms(inside[8:])]
        elif kind == "ilst":
            for index, entry in _atoms(inside):
                number = int.from_bytes(index.encode("latin1"), "big")
                values = [_text(value) for of, value in _atoms(entry) if of == "data"]
                if 0 < number <= len(keys) and values:
                    yield keys[number - 1], values[0]


def _text(value: bytes) -> str:
    """Return a value of metadata as text: its type, 4 bytes of the language, then text or a
    number."""
    kind, body = int.from_bytes(value[:4], "big"), value[8:]
    if kind in (21, 22) and len(body) <= 8:
        return str(int.from_bytes(body, "big", signed=kind == 21))
    if (kind, len(body)) in ((23, 4), (24, 8)):
        return f"{struct.unpack('>f' if kind == 23 else '>d', body)[0]:g}"
    return body.decode("utf-8", "replace")

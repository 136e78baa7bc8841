"""What the calibration readers share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cl import InputError
from psfs.cameras.calibration.handedness import right_handed
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.units import Unit, metres_per_unit, scaled_rig
from psfs.common import files
from psfs.common.files import naming as naming

Size = tuple[int, int]
#: Picture sizes (width, height) for files that lack them: one for all, one per camera name, or
#: a function from all the names to their sizes.
Sizes = Size | Mapping[str, Size] | Callable[[Sequence[str]], Sequence[Size]] | None

#: Of a calibration: those of 64 cameras take less than 100 kB.
MOST_BYTES = 4 * 2**20
#: Numbers that a value has, at most; a camera's distortion is the longest.
_MOST_NUMBERS = 64

#: Deviations of R from a rotation up to this are rounding in the file, and are mended.
ROUNDING = 1e-3


@dataclass(frozen=True, eq=False)
class Calibration(CameraRig):
    """A rig as a file gave it, in metres. unit: what the file's numbers were taken for. notes: what
    was guessed, or mended."""

    unit: Unit = "m"
    notes: tuple[str, ...] = ()


def read_text(path: Path) -> str:
    """Return the text of a file. Raises InputError naming it, MissingFileError if it is absent."""
    text: str = files.read_text(path, "a calibration", MOST_BYTES)
    return text


def numbers(words: Sequence[str], what: str) -> np.ndarray:
    """Return the words as float64. Raises InputError naming the first that is no number."""
    values = []
    for word in words:
        try:
            values.append(float(word))
        except ValueError:
            shown = word if len(word) <= 40 else f"{word[:40]}..."
            raise InputError(f"{what}: found {shown!r}; expected a number") from None
    return np.array(values)


def array(value: Any, count: int | None, what: str) -> np.ndarray:
    """Return `value` as `count` finite float64 numbers; None for any number of them."""
    shown = repr(value) if len(repr(value)) < 100 else f"{repr(value)[:100]}..."
    try:
        plain = np.asarray(value)
        if plain.dtype.kind not in "iuf" or plain.size > _MOST_NUMBERS:
            raise ValueError
        flat = plain.astype(np.float64).ravel()
    except (TypeError, ValueError, OverflowError, RecursionError):
        raise InputError(f"{what} is {shown}; expected a list of numbers") from None
    if count is not None and flat.size != count:
        raise InputError(f"{what} has {flat.size} numbers; expected {count}")
    if not np.isfinite(flat).all():
        raise InputError(f"{what} holds a number that is not finite")
    return flat


def whole_size(width: float, height: float, what: str) -> Size:
    """Return the size of a picture, px. Raises InputError unless both are whole numbers."""
    if width != int(width) or height != int(height):
        raise InputError(f"{what} is {width:g} x {height:g}; expected whole numbers of pixels")
    return int(width), int(height)


def rotation_matrix(value: Any, what: str) -> np.ndarray:
    """Return (3, 3) from a Rodrigues vector (3 numbers) or a matrix (9 numbers, row-major).

    A matrix within `ROUNDING` of a rotation becomes the nearest rotation (by SVD); others are
    passed on for `Camera` to refuse. One of a left-handed world is mended, see `right_handed`.
    """
    flat = array(value, None, what)
    if flat.size == 3:
        return right_handed(cv2.Rodrigues(flat)[0])  # so that mixed worlds are noticed
    if flat.size != 9:
        raise InputError(f"{what} has {flat.size} numbers; expected 3 (Rodrigues) or 9 (a matrix)")
    R = flat.reshape(3, 3)
    if np.abs(R @ R.T - np.eye(3)).max() < ROUNDING:
        left, _, right = np.linalg.svd(R)
        R = right_handed(left @ right)
    return R


def sizes_for(names: Sequence[str], sizes: Sizes) -> list[Size]:
    """Return the size of each named camera. Raises InputError where it is not known."""
    if callable(sizes):
        return list(sizes(names))
    if isinstance(sizes, Mapping):
        missing = [name for name in names if name not in sizes]
        if missing:
            raise InputError(f"no picture size is known for camera {', '.join(missing)}")
        return [sizes[name] for name in names]
    if sizes is None:
        raise InputError("the file holds no picture sizes; pass sizes=(width, height)")
    return [sizes] * len(names)


def rig_of(
    names: Sequence[str],
    sizes: Sizes,
    camera: Callable[[str, Size], Camera],
    unit: Unit | None,
    default: Unit,
) -> Calibration:
    """Return the rig, in metres, of what `camera(name, size)` makes of each of the names."""
    pairs = zip(names, sizes_for(names, sizes), strict=True)
    return in_metres(CameraRig(tuple(camera(*pair) for pair in pairs)), unit, default)


def in_metres(rig: CameraRig, unit: Unit | None, default: Unit) -> Calibration:
    """Return the rig as read, in `unit` or the format's `default` unit, converted to metres."""
    given = default if unit is None else unit
    return Calibration(scaled_rig(rig, metres_per_unit(given)).cameras, given)

"""Parse numbers, rotations, sizes and units for all calibration readers, and mirror left-handed
worlds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np

from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.units import Unit, metres_per_unit, scale_rig
from psfs.common import files
from psfs.common.files import name_file_in_errors as name_file_in_errors
from psfs.common.toml import MOST_BYTES as MOST_BYTES

#: Takes a left-handed world to a right-handed one: negates X.
MIRROR = np.diag([-1.0, 1.0, 1.0])
LEFT_HANDED = "the calibration's world is left-handed: its X axis is negated"

#: One entry per rotation of the calibration being read: whether it is left-handed.
_seen: ContextVar[list[bool] | None] = ContextVar("handedness", default=None)


def make_right_handed(R: np.ndarray) -> np.ndarray:
    """Return R (3, 3), orthogonal, in the mirrored world if its determinant is -1."""
    left = bool(np.linalg.det(R) < 0)
    seen = _seen.get()
    if seen is not None:
        seen.append(left)
    return R @ MIRROR if left else R


@contextmanager
def record_handedness() -> Iterator[list[bool]]:
    """Collect for each rotation that is read inside whether it is left-handed."""
    seen: list[bool] = []
    token = _seen.set(seen)
    try:
        yield seen
    finally:
        _seen.reset(token)


def check_same_handedness(seen: list[bool]) -> None:
    """Raise InputError if some rotations are left-handed and others are not."""
    if any(seen) and not all(seen):
        raise InputError(
            f"{sum(seen)} of {len(seen)} rotations have determinant -1, the others 1; expected "
            "all cameras in one world, right-handed or left-handed"
        )


Size = tuple[int, int]
#: Picture sizes (width, height) for files that lack them: one for all cameras, one per camera name,
#: or a function from all names to their sizes.
Sizes = Size | Mapping[str, Size] | Callable[[Sequence[str]], Sequence[Size]] | None

#: Half a turn about x: from a camera's axes with y up and z backward to OpenCV's, and back.
TO_OPENCV = np.diag([1.0, -1.0, -1.0])
#: Most numbers in one value; the longest value is the distortion.
_MOST_NUMBERS = 64

#: Up to this deviation from a rotation, R is taken for a rounded rotation and corrected.
ROUNDING = 1e-3

#: Longest rotation vector, rad; some programs write a turn too many.
_MOST_TURN = 13.0


@dataclass(frozen=True, eq=False)
class Calibration(CameraRig):
    """A camera rig as read from a file, in metres.

    unit: length unit assumed for the file's numbers. notes: remarks on guesses and corrections.
    """

    unit: Unit = "m"
    notes: tuple[str, ...] = ()


def read_text(path: Path, encoding: str = "UTF-8") -> str:
    """Read the text of a file. Raises InputError naming it, MissingFileError if it is absent."""
    return files.read_text(path, "a calibration", MOST_BYTES, encoding)


#: No length, px or mm, or angle is as large; the products of a few such are still finite.
_TOO_LARGE = 1e60


def parse_numbers(words: Sequence[str], what: str) -> np.ndarray:
    """Convert words to float64. Raises InputError naming the first that is not a number, or is too
    large to be computed with."""
    values = []
    for word in words:
        shown = repr(word if len(word) <= 40 else f"{word[:40]}...")
        try:
            values.append(float(word))
        except ValueError:
            raise InputError(f"{what}: found {shown}; expected a number") from None
        if _TOO_LARGE < abs(values[-1]) < np.inf:  # cameras check whether numbers are finite
            raise InputError(f"{what}: found {shown}; expected a number up to {_TOO_LARGE:g}")
    return np.array(values)


def parse_array(value: object, count: int | None, what: str) -> np.ndarray:
    """Convert `value` to `count` finite float64 numbers; count None: any number of them."""
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


def check_whole_size(width: float, height: float, what: str) -> Size:
    """Return the size of a picture, px. Raises InputError unless both are whole numbers."""
    if width != int(width) or height != int(height):
        raise InputError(f"{what} is {width:g} x {height:g}; expected whole numbers of pixels")
    return int(width), int(height)


def parse_rotation(value: object, what: str) -> np.ndarray:
    """Convert a Rodrigues vector (3 numbers) or a matrix (9 numbers, row-major) to R (3, 3).

    A matrix within `ROUNDING` of a rotation becomes the nearest rotation (by SVD); any other is
    returned unchanged, for `Camera` to reject. `make_right_handed` mirrors that of a left-handed
    world.
    """
    flat = parse_array(value, None, what)
    if flat.size == 3:
        if np.linalg.norm(flat) > _MOST_TURN:
            raise InputError(f"{what} turns by {np.linalg.norm(flat):.3g} rad; expected up to 6.3")
        # A Rodrigues vector is right-handed: this records it, so that mixed worlds are noticed.
        return make_right_handed(cv2.Rodrigues(flat)[0])
    if flat.size != 9:
        raise InputError(f"{what} has {flat.size} numbers; expected 3 (Rodrigues) or 9 (a matrix)")
    R = flat.reshape(3, 3)
    if np.abs(R @ R.T - np.eye(3)).max() < ROUNDING:
        left, _, right = np.linalg.svd(R)
        R = make_right_handed(left @ right)
    return R


def find_sizes(names: Sequence[str], sizes: Sizes) -> list[Size]:
    """Return the size of each named camera. Raises InputError for a camera without a size."""
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


def build_rig(
    names: Sequence[str],
    sizes: Sizes,
    camera: Callable[[str, Size], Camera],
    unit: Unit | None,
    default: Unit,
) -> Calibration:
    """Build a rig in metres from the cameras that `camera(name, size)` returns for each name."""
    pairs = zip(names, find_sizes(names, sizes), strict=True)
    return convert_to_metres(CameraRig(tuple(camera(*pair) for pair in pairs)), unit, default)


def read_attributes(
    camera: ElementTree.Element, tag: str, names: Sequence[str], name: str
) -> np.ndarray:
    """Return the numbers of an element inside a camera's. Raises InputError naming camera, element
    and attribute."""
    element = camera.find(tag)
    missing = [key for key in names if element is None or key not in element.attrib]
    if element is None or missing:
        raise InputError(f"camera {name}: {tag} lacks {', '.join(missing)}")
    return parse_numbers([element.attrib[key] for key in names], f"camera {name}: {tag}")


def convert_to_metres(rig: CameraRig, unit: Unit | None, default: Unit) -> Calibration:
    """Convert the rig from `unit`, or from the format's `default` unit, to metres."""
    given = default if unit is None else unit
    return Calibration(scale_rig(rig, metres_per_unit(given)).cameras, given)

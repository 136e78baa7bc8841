"""Build rigs from what files say of each camera: one table of keys, units and directions per
format."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import scipy

from cl import InputError
from psfs.cameras.camera import MOST_CAMERAS, Camera, CameraRig
from psfs.cameras.names import join_names, natural_key
from psfs.cameras.units import Unit, metres_per_unit, scale_rig
from psfs.common import files
from psfs.common.files import MOST_TOML_BYTES as MOST_TOML_BYTES
from psfs.common.files import name_file_in_errors as name_file_in_errors

#: Takes a left-handed world to a right-handed one: negates X.
MIRROR = np.diag([-1.0, 1.0, 1.0])
LEFT_HANDED = "the calibration's world is left-handed: its X axis is negated"

Size = tuple[int, int]
#: Picture sizes (width, height) for files that lack them: one for all cameras, or a function from
#: all names to their sizes.
Sizes = Size | Callable[[Sequence[str]], Sequence[Size]] | None

#: Half a turn about x: from a camera's axes with y up and z backward to OpenCV's, and back.
TO_OPENCV = np.diag([1.0, -1.0, -1.0])
#: Most numbers in one value; the longest value is the distortion.
MOST_NUMBERS = 64
#: Up to this deviation from a rotation, R is taken for a rounded rotation and corrected.
_ROUNDING = 1e-3
#: No length, px or mm, or angle is as large; the products of a few such are still finite.
_TOO_LARGE = 1e60

#: What a file says of one camera, by key.
Record = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Calibration(CameraRig):
    """A camera rig as read from a file, in metres.

    unit: length unit assumed for the file's numbers. notes: remarks on guesses and corrections.
    """

    unit: Unit = "m"
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Layout:
    """Where a program's records have what.

    program: its name; cameras are sorted by their names, without one they stay as in the file. K:
    fx fy cx cy, or a matrix. distortion: the key of k1 k2 p1 p2 k3, or those of k1 k2 k3 and p1 p2.
    R and t, or pose, a matrix of 3x4 or 4x4. size: one key with width and height, or two. unit: of
    lengths. by_columns: whether matrices are stored by columns. pose_of: what the pose maps: the
    world to the camera, back, or the camera before to this one. opengl: whether the camera's axes
    are y up and z backward. lens: a key with the values that say OpenCV's lens and its fisheye
    lens; other values are refused. kappa: Tsai's distortion. file: what of a file's name is the
    camera's.
    """

    program: str
    K: str
    distortion: tuple[str, ...]
    R: str = ""
    t: str = ""
    pose: str = ""
    size: tuple[str, ...] = ()
    unit: Unit = "m"
    by_columns: bool = False
    pose_of: Literal["world", "camera", "neighbour"] = "world"
    opengl: bool = False
    lens: tuple[str, tuple[object, ...], tuple[object, ...]] = ("", (), ())
    kappa: str = ""
    file: str = r"(.+)\.\w+"

    def fits(self, records: Sequence[Record]) -> bool:
        """Return whether all records have the keys of this layout."""
        keys = [self.K, *self.distortion, self.R, self.t, self.pose, *self.size]
        needed = {key for key in keys if key}
        first = {self.pose} if self.pose_of == "neighbour" else set()
        return all(needed - (set() if k else first) <= row.keys() for k, row in enumerate(records))


#: Of records that readers make themselves, in the order of the file. Sizes may be absent.
PLAIN = Layout(
    "", "K", ("distortion",), "R", "t", size=("size",), lens=("fisheye", (None, False), (True,)),
    kappa="kappa",
)  # fmt: skip
#: The same with poses from the camera, with y up and z backward, to the world.
OPENGL_POSES = Layout(
    "OpenGL", "K", ("distortion",), pose="pose", size=("size",), pose_of="camera", opengl=True,
    lens=PLAIN.lens,
)  # fmt: skip


def read_text(path: Path, encoding: str = "UTF-8") -> str:
    """Read the text of a file. Raises InputError naming it, MissingFileError if it is absent."""
    return files.read_text(path, "a calibration", MOST_TOML_BYTES, encoding)


def parse_numbers(words: Sequence[str], what: str) -> np.ndarray:
    """Convert words to float64. Raises InputError naming the first that is not a number, or is too
    large to be computed with."""
    values = []
    for word in words:
        quoted = repr(word if len(word) <= 40 else f"{word[:40]}...")
        try:
            values.append(float(word))
        except ValueError:
            raise InputError(f"{what}: found {quoted}; expected a number") from None
        if _TOO_LARGE < abs(values[-1]) < np.inf:  # cameras check whether numbers are finite
            raise InputError(f"{what}: found {quoted}; expected a number up to {_TOO_LARGE:g}")
    return np.array(values)


def parse_array(value: object, count: int | None, what: str) -> np.ndarray:
    """Convert `value` to `count` finite float64 numbers; count None: any number of them."""
    quoted = repr(value) if len(repr(value)) < 100 else f"{repr(value)[:100]}..."
    try:
        plain = np.asarray(value)
        if plain.dtype.kind not in "iuf" or plain.size > MOST_NUMBERS:
            raise ValueError
        flat = plain.astype(np.float64).ravel()
    except (TypeError, ValueError, OverflowError, RecursionError):
        raise InputError(f"{what} is {quoted}; expected a list of numbers") from None
    if count is not None and flat.size != count:
        raise InputError(f"{what} has {flat.size} numbers; expected {count}")
    if not np.isfinite(flat).all():
        raise InputError(f"{what} holds a number that is not finite")
    return flat


def parse_quaternion(values: np.ndarray, what: str) -> np.ndarray:
    """Return the rotation (3, 3) of a quaternion x y z w. Raises InputError unless its length is 1,
    to one percent."""
    length = float(np.linalg.norm(values))
    if not abs(length - 1) < 0.01:
        raise InputError(f"{what}: a quaternion of length {length:.3g}; expected 1")
    return scipy.spatial.transform.Rotation.from_quat(values).as_matrix()


def find_sizes(names: Sequence[str], sizes: Sizes) -> list[Size]:
    """Return the size of each named camera. Raises InputError for a camera without a size."""
    if callable(sizes):
        return list(sizes(names))
    if sizes is None:
        raise InputError("the file holds no picture sizes; pass sizes=(width, height)")
    return [sizes] * len(names)


def build(
    layout: Layout, records: Iterable[tuple[str, Record]], unit: Unit | None, sizes: Sizes
) -> Calibration:
    """Return the rig, in metres, of named records; left-handed worlds are mirrored.

    sizes: of the pictures of cameras whose records have none. Raises InputError naming camera and
    key, and if only some rotations are left-handed.
    """
    records = list(records)
    if len(records) > MOST_CAMERAS:
        raise InputError(f"{len(records)} cameras; expected at most {MOST_CAMERAS}")
    sized = [bool(layout.size) and {*layout.size} <= record.keys() for _, record in records]
    known = [] if all(sized) else find_sizes([name for name, _ in records], sizes)
    cameras, left, before = [], [], np.eye(4)
    for row, (name, record) in enumerate(records):
        pose = _read_pose(layout, record, f"camera {name}")
        if layout.pose_of == "neighbour":
            pose = before = pose @ before
        R, mirrored = _mend_rotation(pose[:3, :3])
        left.append(mirrored)
        size = _read_size(layout, record, name) if sized[row] else known[row]
        cameras.append(_make_camera(layout, name, record, (R, pose[:3, 3]), size))
    if any(left) and not all(left):
        raise InputError(
            f"{sum(left)} of {len(left)} rotations have determinant -1, the others 1; expected "
            "all cameras in one world, right-handed or left-handed"
        )
    if layout.program:
        cameras.sort(key=lambda camera: natural_key(camera.name))
    unit = layout.unit if unit is None else unit
    rig = scale_rig(CameraRig(tuple(cameras)), metres_per_unit(unit))
    return Calibration(rig.cameras, unit, (LEFT_HANDED,) if any(left) else ())


def _get(record: Record, key: str, what: str) -> Any:
    if key not in record:
        raise InputError(f"{what} lacks the key {key}")
    return record[key]


def _make_camera(
    layout: Layout, name: str, record: Record, pose: tuple[np.ndarray, np.ndarray], size: Size
) -> Camera:
    what = f"camera {name}"
    K = parse_array(_get(record, layout.K, what), None, f"{what}: {layout.K}")
    if K.size == 4:
        K = np.array([K[0], 0, K[2], 0, K[1], K[3], 0, 0, 1])
    side = 4 if K.size == 16 else 3
    if K.size != side**2:
        raise InputError(f"{what}: {layout.K} has {K.size} numbers; expected 4, 9 or 16")
    K = K.reshape(side, side)[:3, :3]
    K = K.T if layout.by_columns else K
    keys = layout.distortion
    parts = [parse_array(_get(record, key, what), None, f"{what}: {key}") for key in keys]
    key, plain, fisheye = layout.lens
    if key and record.get(key) not in (*plain, *fisheye):
        lenses = join_names(f"{lens}" for lens in (*plain, *fisheye) if lens is not None)
        raise InputError(f"{what}: {key} is {record.get(key)!r}; expected {lenses}")
    bent = bool(key) and record.get(key) in fisheye
    (kappa,) = parse_array(record.get(layout.kappa, 0.0), 1, f"{what}: {layout.kappa}")
    radial, *tangential = parts
    distortion = np.concatenate([radial[:2], *tangential, radial[2:]])
    return Camera(name, K, distortion, *pose, size, kappa=float(kappa), fisheye=bent)


def _read_pose(layout: Layout, record: Record, what: str) -> np.ndarray:
    """Return the transform (4, 4) from the world, or the neighbour, to the camera."""
    whole = np.eye(4)
    if layout.R:
        R = parse_array(_get(record, layout.R, what), None, f"{what}: {layout.R}")
        if R.size not in (3, 9):
            raise InputError(
                f"{what}: {layout.R} has {R.size} numbers; expected 3 (Rodrigues) or 9 (a matrix)"
            )
        turn = cv2.Rodrigues(R)[0] if R.size == 3 else R.reshape(3, 3)
        whole[:3, :3] = turn.T if layout.by_columns else turn
        whole[:3, 3] = parse_array(_get(record, layout.t, what), 3, f"{what}: {layout.t}")
    elif layout.pose in record:
        rows = parse_array(record[layout.pose], None, f"{what}: {layout.pose}")
        if rows.size not in (12, 16):
            raise InputError(f"{what}: {layout.pose} has {rows.size} numbers; expected 12 or 16")
        whole[:3] = rows[:12].reshape(3, 4)
    if layout.pose_of == "camera":
        whole[:3, :3] = whole[:3, :3].T
        whole[:3, 3] = -whole[:3, :3] @ whole[:3, 3]
    if layout.opengl:
        whole[:3] = TO_OPENCV @ whole[:3]
    return whole


def _mend_rotation(matrix: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return the rotation (3, 3) nearest to a rounded one, in the mirrored world if that is
    left-handed, and whether it is; any other matrix as it is, for `Camera` to reject."""
    if not np.abs(matrix @ matrix.T - np.eye(3)).max() < _ROUNDING:
        return matrix, False
    first, _, second = np.linalg.svd(matrix)
    R = first @ second
    left = bool(np.linalg.det(R) < 0)
    return (R @ MIRROR if left else R), left


def _read_size(layout: Layout, record: Record, name: str) -> Size:
    what = f"camera {name}: {join_names(layout.size)}"
    values = np.concatenate([parse_array(record[key], None, what) for key in layout.size])
    if len(values) != 2:
        raise InputError(f"{what} has {len(values)} numbers; expected width and height")
    width, height = values
    if width != int(width) or height != int(height):
        raise InputError(f"{what} is {width:g} x {height:g}; expected whole numbers of pixels")
    return int(width), int(height)


def read_files(
    paths: Sequence[Path], parse: Callable[[Path], dict[str, Any]], layout: Layout,
    unit: Unit | None, sizes: Sizes, names: Sequence[str] | None = None,
) -> Calibration:  # fmt: skip
    """Read one camera per path, named after the file or by `names`."""
    records = []
    for name, path in zip(names or [path.stem for path in paths], paths, strict=True):
        with name_file_in_errors(path):
            records.append((name, parse(path)))
    with name_file_in_errors(paths[0] if len(paths) == 1 else paths[0].parent):
        return build(layout, records, unit, sizes)

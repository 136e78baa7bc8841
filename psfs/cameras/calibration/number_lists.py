"""Read calibrations that are lists of numbers: HumanEva, Middlebury, Surrey.

Read the `.cal` files of HumanEva and bodytrack: one camera per file, one number after another.

fc(2) cc(2) alpha kc(5 = k1 k2 p1 p2 k3) R row-major(9) T(3), mm, x_cam = R X + T; further numbers
are ignored.

Read Middlebury's multi-view `*_par.txt`.

The first line is the number of views; each further line has the image's name, K (9, row-major), R
(9) and t (3), with P = K [R t].

Read Surrey's list of cameras (SurfCap, CVSSP3D).

The numbers of cameras and of distortion coefficients; then for each camera its first and last row,
first and last column, `fx fy cx cy`, the coefficients k1, k2, ..., R by rows (9) and t (3), with
x_cam = R x + t. Numbers are separated by any white space.
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
    build_rig,
    build_rig_of_files,
    check_whole_size,
    convert_to_metres,
    name_file_in_errors,
    parse_numbers,
    parse_rotation,
    read_text,
)
from psfs.cameras.camera import MOST_CAMERAS, Camera, CameraRig
from psfs.cameras.units import Unit

_HUMANEVA_COUNT = 22


def read_humaneva(paths: Sequence[Path], unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read one camera per path, named after the file. Millimetres unless `unit` says otherwise."""
    return build_rig_of_files(paths, sizes, _camera_humaneva, unit, default="mm")


def _camera_humaneva(path: Path, size: Size) -> Camera:
    values = parse_numbers(read_text(path).replace(",", " ").split(), "HumanEva calibration")
    if values.size < _HUMANEVA_COUNT:
        raise InputError(f"{values.size} numbers; expected at least {_HUMANEVA_COUNT} (HumanEva)")
    fx, fy, cx, cy, alpha = values[:5]
    if not np.isfinite(values[:_HUMANEVA_COUNT]).all():
        raise InputError("holds a number that is not finite; expected HumanEva calibration")
    return Camera(
        name=path.stem,
        K=np.array([[fx, alpha * fx, cx], [0, fy, cy], [0, 0, 1]]),
        distortion=values[5:10],
        R=parse_rotation(values[10:19], f"camera {path.stem}: R"),
        t=values[19:22],
        size=size,
    )


_MIDDLEBURY_NUMBERS = 21


def read_middlebury(path: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read the cameras in the order of the file, named after their images without suffix.

    Metres unless `unit` says otherwise. No distortion.
    """
    with name_file_in_errors(path):
        lines = [line.split() for line in read_text(path).splitlines() if line.strip()]
        promised = " ".join(lines.pop(0)) if lines else "nothing"
        if promised != str(len(lines)):
            raise InputError(f"{len(lines)} views; the first line promises {promised}")
        names = [Path(words[0]).stem for words in lines]
        of_view = dict(zip(names, lines, strict=True))
        return build_rig(
            names, sizes, lambda n, size: _camera_middlebury(n, of_view[n][1:], size), unit, "m"
        )


def _camera_middlebury(name: str, words: list[str], size: Size) -> Camera:
    if len(words) != _MIDDLEBURY_NUMBERS:
        raise InputError(f"view {name}: {len(words)} numbers; expected {_MIDDLEBURY_NUMBERS}")
    values = parse_numbers(words, f"view {name}")
    return Camera(
        name=name,
        K=values[:9] / values[8],
        distortion=values[:0],
        R=parse_rotation(values[9:18], f"view {name}: R"),
        t=values[18:],
        size=size,
    )


def looks_like_surrey(text: str) -> bool:
    """Return whether the first line states the numbers of cameras and of coefficients."""
    words = text.lstrip().partition("\n")[0].split()
    try:
        count, order = map(int, words)
    except ValueError:
        return False
    return 0 < count <= MOST_CAMERAS and 0 <= order <= 5


def read_surrey(path: Path, unit: Unit | None) -> Calibration:
    """Read the cameras, named cam01, cam02, ... Metres unless `unit` says otherwise."""
    with name_file_in_errors(path):
        text = read_text(path)
        if not looks_like_surrey(text):
            raise InputError("expected Surrey's list, which begins with two numbers in a line")
        values = parse_numbers(text.split(), "Surrey's calibration")
        order, needed = int(values[1]), int(2 + values[0] * (20 + values[1]))
        if len(values) != needed:
            raise InputError(
                f"{len(values)} numbers; expected {needed} of Surrey's list of {values[0]:.0f} "
                f"cameras with {order} coefficients"
            )
        rows = values[2:].reshape(int(values[0]), 20 + order)
        cameras = [
            _camera_surrey(f"cam{index:02d}", row, order) for index, row in enumerate(rows, 1)
        ]
        return convert_to_metres(CameraRig(tuple(cameras)), unit, default="m")


def _camera_surrey(name: str, row: np.ndarray, order: int) -> Camera:
    first_row, last_row, first_column, last_column, fx, fy, cx, cy = row[:8]
    if first_row or first_column:
        raise InputError(f"{name}: the picture begins at {first_column:g}, {first_row:g}, not 0, 0")
    k = np.zeros(5)
    radial = row[8 : 8 + order]
    if order > 3 and radial[3:].any():
        raise InputError(f"{name}: {order} radial coefficients; expected at most 3")
    k[[0, 1, 4][: min(order, 3)]] = radial[:3]
    return Camera(
        name=name,
        K=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        distortion=k,
        R=parse_rotation(row[8 + order : 17 + order], f"{name}: R"),
        t=row[17 + order :],
        size=check_whole_size(last_column + 1, last_row + 1, f"{name}: the picture"),
    )

"""Read Surrey's list of cameras (SurfCap, CVSSP3D).

The numbers of cameras and of distortion coefficients; then for each camera its first and last row,
first and last column, `fx fy cx cy`, the coefficients k1, k2, ..., R by rows (9) and t (3), with
x_cam = R x + t. Numbers are separated by any white space.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cl import InputError
from psfs.cameras.calibration.common import (
    Calibration,
    check_whole_size,
    convert_to_metres,
    name_file_in_errors,
    parse_numbers,
    parse_rotation,
    read_text,
)
from psfs.cameras.camera import MOST_CAMERAS, Camera, CameraRig
from psfs.cameras.units import Unit


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
        cameras = [_camera(f"cam{index:02d}", row, order) for index, row in enumerate(rows, 1)]
        return convert_to_metres(CameraRig(tuple(cameras)), unit, default="m")


def _camera(name: str, row: np.ndarray, order: int) -> Camera:
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

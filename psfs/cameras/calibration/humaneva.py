"""Read the `.cal` files of HumanEva and bodytrack: one camera per file, one number after another.

fc(2) cc(2) alpha kc(5 = k1 k2 p1 p2 k3) R row-major(9) T(3), mm, x_cam = R X + T; further numbers
are ignored.
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
    parse_numbers,
    parse_rotation,
    read_text,
)
from psfs.cameras.camera import Camera
from psfs.cameras.units import Unit

_COUNT = 22


def read_humaneva(paths: Sequence[Path], unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read one camera per path, named after the file. Millimetres unless `unit` says otherwise."""
    return build_rig_of_files(paths, sizes, _camera, unit, default="mm")


def _camera(path: Path, size: Size) -> Camera:
    values = parse_numbers(read_text(path).replace(",", " ").split(), "HumanEva calibration")
    if values.size < _COUNT:
        raise InputError(f"{values.size} numbers; expected at least {_COUNT} (HumanEva)")
    fx, fy, cx, cy, alpha = values[:5]
    if not np.isfinite(values[:_COUNT]).all():
        raise InputError("holds a number that is not finite; expected HumanEva calibration")
    return Camera(
        name=path.stem,
        K=np.array([[fx, alpha * fx, cx], [0, fy, cy], [0, 0, 1]]),
        distortion=values[5:10],
        R=parse_rotation(values[10:19], f"camera {path.stem}: R"),
        t=values[19:22],
        size=size,
    )

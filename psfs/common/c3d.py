"""Read the points of C3D files, the exchange format of motion laboratories."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cl import InputError
from psfs.common.files import temporary_folder
from psfs.common.numbers import METRES, drop_origin
from psfs.common.reading import open_input, parsing


@dataclass(frozen=True, eq=False)
class C3dPoints:
    """Labelled points of a C3D.

    positions: (F, P, 3) m in the file's axes, NaN where missing: with a residual below 0, or at
    0 0 0. rate: frames per second. first: number of the first frame, from 0 on. up: the up axis as
    POINT:Y_SCREEN states it, or None.
    """

    names: tuple[str, ...]
    positions: np.ndarray
    rate: float
    first: int
    up: str | None


def read_c3d_points(path: Path) -> C3dPoints:
    """Read the points of a C3D in metres, centimetres or millimetres. Raises InputError naming the
    file."""
    import ezc3d  # slow to import

    with parsing(path, "a C3D with points"):
        with open_input(path, "a C3D") as opened, temporary_folder() as folder:
            plain = folder / "motion.c3d"  # ezc3d accepts only paths in UTF-8
            with plain.open("wb") as copy:
                shutil.copyfileobj(opened, copy)
            file: Any = ezc3d.c3d(str(plain))
        point, points = file["parameters"]["POINT"], file["data"]["points"]
        residuals = file["data"]["meta_points"]["residuals"]
        names = tuple(str(name) for name in point["LABELS"]["value"])
        unit = str(point["UNITS"]["value"][0]) if point["UNITS"]["value"] else "mm"
        rate = float(point["RATE"]["value"][0])
        first = int(file["header"]["points"]["first_frame"])
        stated = point["Y_SCREEN"]["value"] if "Y_SCREEN" in point else []
    if unit.strip().lower() not in METRES:
        raise InputError(f"{path}: POINT:UNITS is {unit!r}; expected {', '.join(METRES)}")
    n_points = points.shape[1]
    if not n_points or len(names) < n_points or not 1e-3 < rate < 1e5:
        raise InputError(
            f"{path}: {n_points} points with {len(names)} labels at {rate:g} frames/s; "
            "expected a label for each, and a rate"
        )
    positions = METRES[unit.strip().lower()] * points[:3].transpose(2, 1, 0)
    missing = (residuals[0].T < 0) | ~np.isfinite(positions).all(-1)
    positions[missing] = np.nan
    positions = drop_origin(positions)
    up = str(stated[0]) if stated else None
    return C3dPoints(names[:n_points], positions, rate, first, up)

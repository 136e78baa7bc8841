"""Write joints, and other values over time, as CSV for spreadsheets and data frames."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from apf.formats.trc import JointSeries
from psfs.common.files import open_text


def write_csv(path: str | Path, series: JointSeries) -> None:
    """Write one row per frame: frame, time_s, then <joint>_x_m, _y_m, _z_m (world, Z up).

    Cells of missing points are empty.
    """
    names = [f"{name}_{axis}_m" for name in series.joint_names for axis in "xyz"]
    values = series.joints.reshape(len(series.frames), len(names)).T
    write_columns(path, series.frames, series.fps, dict(zip(names, values, strict=True)), 6)


def write_columns(
    path: str | Path,
    frames: np.ndarray,
    fps: float,
    columns: Mapping[str, np.ndarray],
    decimals: int,
) -> None:
    """Write frame, time_s and `columns` (F,), with that many decimals, one row per frame.

    Cells are empty where the values are NaN. Raises InputError if the file cannot be written.
    """
    with open_text(path) as file:
        file.write(",".join(["frame", "time_s", *columns]) + "\n")
        for frame, *row in zip(frames, *columns.values(), strict=True):
            cells = ("" if np.isnan(value) else f"{value:.{decimals}f}" for value in row)
            file.write(",".join([f"{frame}", f"{frame / fps:.6f}", *cells]) + "\n")

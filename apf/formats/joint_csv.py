"""Write joints as comma-separated values, for spreadsheets and data frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from apf.formats.trc import JointSeries
from psfs.common.files import open_text


def write_csv(path: str | Path, series: JointSeries) -> None:
    """Write one row per frame: frame, time_s, then <joint>_x_m, _y_m, _z_m (world, Z up).

    Cells of missing points are empty.
    """
    columns = [f"{name}_{axis}_m" for name in series.joint_names for axis in "xyz"]
    with open_text(path) as file:
        file.write(",".join(["frame", "time_s", *columns]) + "\n")
        for frame, time, joints in zip(series.frames, series.times, series.joints, strict=True):
            cells = ("" if np.isnan(value) else f"{value:.6f}" for value in joints.ravel())
            values = ",".join(cells)
            file.write(f"{frame},{time:.6f},{values}\n")

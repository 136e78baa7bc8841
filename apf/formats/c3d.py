"""C3D files, the exchange format of motion laboratories (Vicon, Qualisys, Visual3D, Mokka).

Written: millimetres, Z up as the tracker's world; POINT:X_SCREEN and Y_SCREEN say so. The residual
of a point is how far it may be away, the root mean square distance by its covariance; a point that
is missing has the residual -1, as the format wants it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from apf.formats.motion import BodyMotion
from psfs.common.files import written_whole


def write_c3d(path: str | Path, motion: BodyMotion) -> None:
    """Write joints and virtual markers. Raises InputError where the file cannot be written."""
    import ezc3d  # takes a while to load

    rate, rows = motion.on_a_beat()
    kept = rows >= 0
    points = np.full((4, motion.points.joints.shape[1], len(rows)), np.nan)
    points[:3, :, kept] = 1000 * motion.points.joints[rows[kept]].transpose(2, 1, 0)
    points[3] = 1.0
    missing = np.isnan(points[:3]).any(0)
    residuals = np.zeros((1, *missing.shape))
    residuals[0][:, kept] = np.nan_to_num(1000 * motion.deviation[rows[kept]].T)
    residuals[0][missing] = -1.0

    file: Any = ezc3d.c3d()
    names = list(motion.points.joint_names)
    file["header"]["points"]["first_frame"] = int(motion.points.frames[0]) if len(rows) else 0
    parameters = file["parameters"]
    parameters["POINT"]["RATE"]["value"] = [rate]
    parameters["POINT"]["LABELS"]["value"] = names
    parameters["POINT"]["DESCRIPTIONS"]["value"] = [name.replace("_", " ") for name in names]
    parameters["POINT"]["UNITS"]["value"] = ["mm"]
    for group, name, value in (
        ("POINT", "X_SCREEN", "+X"),
        ("POINT", "Y_SCREEN", "+Z"),
        ("MANUFACTURER", "SOFTWARE", "psfs-apf"),
        ("MANUFACTURER", "REMARK", motion.note),
    ):
        file.add_parameter(group, name, value)
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = residuals
    with written_whole(path) as temporary:
        file.write(str(temporary))

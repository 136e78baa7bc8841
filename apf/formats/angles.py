"""Write joint angles over time: CSV with clinical names, and OpenSim's MOT."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from apf.body.angles import anatomical_frames, angles_between, decompose, unwrap_known
from apf.body.kinematics import posed_joints
from apf.body.limbs import limb_angles
from apf.body.model import BodyModel
from apf.formats.joint_csv import write_columns
from apf.formats.motion import BodyMotion, interpolate_gaps
from apf.formats.skeleton import TO_Y_UP
from apf.formats.trc import JointSeries
from psfs.common.files import open_text
from psfs.common.numbers import FROM_Y_UP

#: OpenSim's coordinates of the pelvis: angles about Z, X' and Y'' against the world, and position.
_PELVIS = ("pelvis_tilt", "pelvis_list", "pelvis_rotation", "pelvis_tx", "pelvis_ty", "pelvis_tz")
#: OpenSim's names and signs of the clinical angles that it has.
_COORDINATES: Mapping[str, tuple[str, int]] = {
    "trunk_flexion": ("lumbar_extension", -1),
    "trunk_right_bending": ("lumbar_bending", 1),
    "trunk_left_rotation": ("lumbar_rotation", 1),
    "neck_flexion": ("neck_flexion", -1),
    "neck_right_bending": ("neck_bending", 1),
    "neck_left_rotation": ("neck_rotation", 1),
    "hip_flexion": ("hip_flexion", 1),
    "hip_adduction": ("hip_adduction", 1),
    "hip_rotation": ("hip_rotation", 1),
    "knee_flexion": ("knee_angle", 1),
    "ankle_dorsiflexion": ("ankle_angle", 1),
    "shoulder_flexion": ("arm_flex", 1),
    "shoulder_adduction": ("arm_add", 1),
    "shoulder_rotation": ("arm_rot", 1),
    "elbow_flexion": ("elbow_flex", 1),
}


def write_angle_csv(
    path: str | Path, angles: Mapping[str, np.ndarray], series: JointSeries
) -> None:
    """Write angles as CSV, one row per frame of `series`.

    Columns: frame, time_s, then <angle>_deg for each of `angles` (F,), degrees, empty where NaN.
    Raises InputError if the file cannot be written.
    """
    columns = {f"{name}_deg": values for name, values in angles.items()}
    write_columns(path, series.frames, series.fps, columns, 5)


def write_mot(path: str | Path, motion: BodyMotion) -> None:
    """Write OpenSim's coordinates: degrees, metres, Y up, (X, Y, Z) = world (x, z, -y).

    The names are those of Rajagopal et al. 2016, where a bent knee has a positive angle. OpenSim
    stops reading at a value that is missing: in lost frames and limbs coordinates are interpolated
    linearly, and held at the ends. Which these are is written into `<name>_filled.csv` beside the
    file, 1 where a coordinate was filled. Raises InputError if a file cannot be written.
    """
    path = Path(path)
    table = opensim_coordinates(motion.body, motion.poses)
    gone = motion.lost[:, None] | (motion.lost_limbs @ limb_angles(motion.body, table))
    columns = interpolate_gaps(np.stack(list(table.values()), -1), motion.points.times, gone)
    columns = np.nan_to_num(columns)  # of somebody who is never there
    beside = path.with_name(f"{path.stem}_filled.csv")
    if gone.any():
        flags = dict(zip(table, gone.T.astype(float), strict=True))
        write_columns(beside, motion.points.frames, motion.points.fps, flags, 0)
    else:
        beside.unlink(missing_ok=True)  # an earlier one
    filled = [f"filled by interpolation where lost, see {beside.name}"] if gone.any() else []
    header = [
        "Coordinates",
        "version=1",
        f"nRows={len(columns)}",
        f"nColumns={1 + len(table)}",
        "inDegrees=yes",
        "",
        *([motion.points.note] if motion.points.note else []),
        *filled,
        "endheader",
        "\t".join(["time", *table]),
    ]
    with open_text(path) as file:
        file.write("\n".join(header) + "\n")
        np.savetxt(
            file, np.column_stack([motion.points.times, columns]), fmt="%.8f", delimiter="\t"
        )


def opensim_coordinates(body: BodyModel, poses: np.ndarray) -> dict[str, np.ndarray]:
    """Compute those of OpenSim's coordinates (N,), degrees and metres, that the body has, by name.

    poses: (N, D).
    """
    frames = anatomical_frames(body, poses)
    table: dict[str, np.ndarray] = {}
    if "pelvis" in frames:
        turned = np.degrees(unwrap_known(decompose(FROM_Y_UP.T @ frames["pelvis"], "ZXY")))
        place = posed_joints(body, poses)[:, body.joint_names.index("pelvis")] @ TO_Y_UP.T
        table |= zip(_PELVIS, (*turned.T, *place.T), strict=True)
    angles = angles_between(frames)
    for side, ending in (("", ""), ("r_", "_r"), ("l_", "_l")):
        for name, (coordinate, sign) in _COORDINATES.items():
            if side + name in angles:
                table[coordinate + ending] = sign * angles[side + name]
    return table

"""Read and write a pose as a text file: one value per degree of freedom, rad and m."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from apf.body.model import BodyModel
from cl import InputError
from psfs.common.files import read_numbers, read_text, write_text
from psfs.common.ranges import FARTHEST

#: Largest angle, rad.
_MOST_TURNS = 1000.0


def read_pose(path: Path, body: BodyModel) -> np.ndarray:
    """Read the first pose (D,) m, rad from a text file with one value per degree of freedom.

    Raises InputError naming the file if it is missing, not numbers, or of another body.
    """
    pose = read_numbers(path)
    if pose.size != body.n_dof or not np.isfinite(pose).all():
        raise InputError(
            f"{path}: {pose.size} values; expected {body.n_dof} finite ones, "
            f"one per degree of freedom of {body.name}"
        )
    comments = [line.partition("#")[2].strip() for line in read_text(path, "numbers").splitlines()]
    names = [comment for comment in comments if comment]
    if len(names) != body.n_dof:  # the comments are the user's own
        names = list(body.dof_names)
    for number, (name, expected) in enumerate(zip(names, body.dof_names, strict=True), 1):
        if name != expected:
            raise InputError(
                f"{path}: value {number} is {name}, of another body; expected {expected} of "
                f"{body.name}"
            )
    check_pose(pose, body, path)
    return pose


def check_pose(pose: np.ndarray, body: BodyModel, where: object) -> None:
    """Raise InputError that names `where` for a `pose` (D,) with implausibly large values."""
    limits = np.full(body.n_dof, FARTHEST)
    limits[body.angles] = _MOST_TURNS
    wrong = np.flatnonzero(~(np.abs(pose) <= limits))
    if wrong.size:
        name, value = body.dof_names[wrong[0]], pose[wrong[0]]
        raise InputError(
            f"{where}: {name} is {value:g}; expected rad and m, up to {limits[wrong[0]]:g}"
        )


def write_pose(path: Path, pose: np.ndarray, body: BodyModel) -> None:
    """Write `pose` (D,) of `body` as a text file that `read_pose` reads.

    It has one line per degree of freedom, with its name as a comment.
    """
    lines = [f"{v:.9g}  # {name}\n" for v, name in zip(pose, body.dof_names, strict=True)]
    write_text(path, "".join(lines))

"""Read the truth: joints of one person or several, and rotations of bones."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from apf.formats.c3d import read_c3d
from apf.formats.trc import JointSeries, read_trc
from cl import InputError
from psfs.common.npz import Values, get_scalar, read_npz
from psfs.common.numbers import drop_origin

_SCHEMA = {
    "joint_names": Values(("joints of one person",), "text"),
    "joints": Values(("frames", "joints of one person", 3), finite=False, low=-1e6, high=1e6),
    "fps": Values(None, low=1e-3, high=1e5),
    "frames": Values(("frames",), "int", low=0, needed=False),
}
_PEOPLE = {
    "joint_names": Values(("joints",), "text"),
    "joints": Values(("frames", "people", "joints", 3), finite=False, low=-1e6, high=1e6),
    "person_names": Values(("people",), "text", needed=False),
}
_BONES = {
    "bone_names": Values(("bones",), "text", needed=False),
    "bone_rotations": Values(("frames", "bones", 3, 3), low=-1.01, high=1.01, needed=False),
}


def read_truth(path: Path) -> tuple[dict[str, JointSeries], dict[str, np.ndarray]]:
    """Return the joints of each person by name, and by bone the rotations (F, 3, 3) of one person,
    in the world from the rest pose; empty without any.

    Read joint_names (J,), joints (F, J, 3) or, of several people, (F, P, J, 3) m, Z up, NaN or
    0 0 0 where missing, fps and perhaps frames (F,), the indices in the sequence (default: 0, 1,
    ...), from an npz; of several people also person_names (P,), of one bone_names (B,) and
    bone_rotations (F, B, 3, 3). Raises InputError.
    """
    what = (
        "a .trc, .c3d or npz with joint_names, joints (frames, joints, 3) or (frames, people, "
        "joints, 3) in metres and fps"
    )
    several = read_npz(path, {}, what).get("joints", np.zeros(())).ndim == 4
    data = read_npz(path, _SCHEMA | (_PEOPLE if several else _BONES), what)
    joints = data["joints"].astype(np.float64)
    joints = drop_origin(joints if several else joints[:, None])
    names = tuple(str(name) for name in data["joint_names"])
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{path}: joint_names holds {twice} twice; expected names that differ")
    if data["fps"].size != 1:
        raise InputError(f"{path}: fps has the shape {data['fps'].shape}; expected one number")
    frames = data.get("frames", np.arange(len(joints))).astype(np.int64)
    if np.any(np.diff(frames) <= 0):
        raise InputError(f"{path}: frames are not ascending; expected each once, in their order")
    numbers = [f"person{k}" for k in range(1, joints.shape[1] + 1)]
    persons = [str(name) for name in data.get("person_names", numbers)] if several else numbers
    if len(set(persons)) < len(persons):
        persons = [f"{number} ({name})" for number, name in zip(numbers, persons, strict=True)]
    fps = float(get_scalar(data["fps"]))
    series = [JointSeries(names, person, fps, frames) for person in joints.swapaxes(0, 1)]
    rotations = {}
    if not several and {"bone_names", "bone_rotations"} <= set(data):
        turns = data["bone_rotations"].astype(np.float64).swapaxes(0, 1)
        rotations = dict(zip(map(str, data["bone_names"]), turns, strict=True))
    return dict(zip(persons, series, strict=True)), rotations


def load_truth(path: str | Path, convention: str = "y-up") -> JointSeries:
    """Read true joints or markers of one person from a .trc (axes after `convention`), a .c3d,
    which states its vertical axis, its rate and its frame numbers, or an npz, see `read_truth`.
    Raises InputError."""
    people = load_people_truth(path, convention)
    if len(people) > 1:
        raise InputError(f"{path}: joints of {len(people)} people; expected those of one")
    return next(iter(people.values()))


def load_people_truth(path: str | Path, convention: str = "y-up") -> dict[str, JointSeries]:
    """Read the true joints of several people, or of one, by name, see `load_truth`. Raises
    InputError."""
    path = Path(path)
    if path.suffix.lower() == ".c3d":
        return {path.stem: read_c3d(path)}
    if path.suffix.lower() == ".trc":
        return {path.stem: read_trc(path, convention)}
    return read_truth(path)[0]

"""Read the body model, initial pose and ranges of PARSEC's *bodytrack* from its own files.

The files hold lengths in mm; everything here is in metres. The formulas follow the program's source
(see the README of the shared sequence), and so does the order of its 31 pose values a0..a30.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from apf.body.kinematics import axis_rotation
from apf.body.model import BodyModel, Bone, Cone, FreeAxis, Joint
from cl import InputError
from psfs.common.files import read_numbers

_N_DOF = 31
_HALF_TURN, _QUARTER = np.pi, np.pi / 2
#: Indices of the pelvis's position in the pose, the only values that are lengths.
TRANSLATIONS = slice(3, 6)
#: The file by which a body is recognised.
_SHAPE = "BodyShapeParameters.txt"

_DOF_NAMES = (
    "pelvis.rx", "pelvis.ry", "pelvis.rz", "pelvis.tx", "pelvis.ty", "pelvis.tz",
    "l_hip.rx", "l_hip.ry", "l_hip.rz", "l_knee.ry",
    "r_hip.rx", "r_hip.ry", "r_hip.rz", "r_knee.ry",
    "l_clavicle.rx", "l_clavicle.ry", "l_shoulder.rx", "l_shoulder.ry", "l_shoulder.rz",
    "l_elbow.ry",
    "r_clavicle.rx", "r_clavicle.ry", "r_shoulder.rx", "r_shoulder.ry", "r_shoulder.rz",
    "r_elbow.ry",
    "thorax.ry", "thorax.rz", "head.rx", "head.ry", "head.rz",
)  # fmt: skip

_PARTS = (
    "torso", "l_thigh", "l_calf", "r_thigh", "r_calf",
    "l_upper_arm", "l_forearm", "r_upper_arm", "r_forearm", "head",
)  # fmt: skip

_EDGES = (
    ("pelvis", "neck"), ("neck", "head_top"),
    ("neck", "l_shoulder"), ("l_shoulder", "l_elbow"), ("l_elbow", "l_wrist"),
    ("neck", "r_shoulder"), ("r_shoulder", "r_elbow"), ("r_elbow", "r_wrist"),
    ("pelvis", "l_hip"), ("l_hip", "l_knee"), ("l_knee", "l_ankle"),
    ("pelvis", "r_hip"), ("r_hip", "r_knee"), ("r_knee", "r_ankle"),
)  # fmt: skip


def is_bodytrack(folder: Path) -> bool:
    """Return whether `folder` holds a bodytrack body."""
    return (folder / _SHAPE).is_file()


def read_poses(path: Path) -> np.ndarray:
    """Read poses (N, 31) from a text file with 31 values (rad, mm) per pose; mm become metres.

    Raises InputError naming the file.
    """
    values = read_numbers(path)
    if values.size == 0 or values.size % _N_DOF:
        raise InputError(f"{path}: {values.size} numbers; expected a multiple of {_N_DOF}")
    _check(values, path, 1e5)
    poses = values.reshape(-1, _N_DOF)
    poses[:, TRANSLATIONS] *= 1e-3
    return poses


def _check(values: np.ndarray, path: Path, most: float) -> None:
    wrong = values[~(np.abs(values) <= most)]  # rejects NaN, too
    if wrong.size:
        raise InputError(f"{path}: holds {wrong[0]:g}; expected numbers up to {most:g}")


def read_body(folder: Path) -> BodyModel:
    """Read the model of BodyShapeParameters.txt with the standard deviations of PoseParameters.txt.

    No limits are set: the shipped initial pose lies outside the shipped ranges, and the program
    does not apply them either. The rest pose is that of InitialPose.txt. Raises InputError naming
    the file that is wrong.
    """
    shape_file, ranges_file = folder / _SHAPE, folder / "PoseParameters.txt"
    shape = read_numbers(shape_file)
    if shape.size != 58:
        raise InputError(
            f"{shape_file}: {shape.size} numbers; expected 58 (10 parts x 4 and 18 lengths)"
        )
    _check(shape, shape_file, 3000)
    if not np.all(shape >= 0):
        raise InputError(f"{shape_file}: holds {shape.min():g}; expected 0 or more")
    ranges = read_numbers(ranges_file)
    if ranges.size != 3 * _N_DOF:
        raise InputError(f"{ranges_file}: {ranges.size} numbers; expected {3 * _N_DOF}")
    _check(ranges, ranges_file, 1e5)
    sigma = ranges[:_N_DOF].copy()
    if not np.all(sigma >= 0):
        raise InputError(f"{ranges_file}: a deviation is {sigma.min():g}; expected 0 or more")
    sigma[TRANSLATIONS] *= 1e-3
    bones = _bones(shape[40:] * 1e-3)
    index = {bone.name: i for i, bone in enumerate(bones)}
    joints = _joints(shape[40:] * 1e-3, index)
    names = [joint.name for joint in joints]
    return BodyModel(
        name="bodytrack",
        bones=bones,
        cones=_cones(shape[:40].reshape(10, 4), shape[40:] * 1e-3, index),
        joints=joints,
        dof_names=_DOF_NAMES,
        lower=np.full(_N_DOF, -np.inf),
        upper=np.full(_N_DOF, np.inf),
        sigma=sigma,
        rest_pose=read_poses(folder / "InitialPose.txt")[0],
        posture_sigma=np.full(_N_DOF, np.inf),
        posture_rise=np.zeros(_N_DOF),
        edges=tuple((names.index(a), names.index(b)) for a, b in _EDGES),
    )


def _inverse_euler(x: int | None, y: int | None, z: int | None) -> tuple[FreeAxis, ...]:
    """Return the axes of E(x, y, z)' with E = Rz Rx Ry, that is Ry(-y) Rx(-x) Rz(-z)."""
    order = (("ry", y), ("rx", x), ("rz", z))
    return tuple(FreeAxis(kind, -1, dof) for kind, dof in order if dof is not None)


def _bones(lengths: np.ndarray) -> tuple[Bone, ...]:
    """Return the tree of 13 bones for the 18 `lengths`, m."""
    about = axis_rotation
    flip_x, flip_y = about(0, _HALF_TURN), about(1, _HALF_TURN)
    arm = about(0, -_QUARTER) @ about(2, _HALF_TURN) @ about(1, -_QUARTER)
    pelvis_axes = tuple(
        FreeAxis(kind, 1, dof)
        for kind, dof in (("tx", 3), ("ty", 4), ("tz", 5), ("rz", 2), ("rx", 0), ("ry", 1))
    )
    neck = (0, 0, -lengths[0])
    tree: list[tuple[str, str, tuple[float, float, float], np.ndarray, tuple[FreeAxis, ...]]] = [
        ("pelvis", "", (0, 0, 0), np.eye(3), pelvis_axes),
        ("l_thigh", "pelvis", (0, lengths[1], 0), flip_y, _inverse_euler(6, 7, 8)),
        ("l_calf", "l_thigh", (0, 0, lengths[2]), np.eye(3), _inverse_euler(None, 9, None)),
        ("r_thigh", "pelvis", (0, -lengths[5], 0), flip_y, _inverse_euler(10, 11, 12)),
        ("r_calf", "r_thigh", (0, 0, lengths[6]), np.eye(3), _inverse_euler(None, 13, None)),
        ("thorax", "pelvis", (0, 0, 0), flip_x, _inverse_euler(None, 26, 27)),
        ("l_clavicle", "thorax", neck, about(0, -_QUARTER), _inverse_euler(14, 15, None)),
        ("l_upper_arm", "l_clavicle", (0, 0, -lengths[9]), arm, _inverse_euler(16, 17, 18)),
        ("l_forearm", "l_upper_arm", (0, 0, -lengths[10]), np.eye(3),
         _inverse_euler(None, 19, None)),
        ("r_clavicle", "thorax", neck, about(0, _QUARTER), _inverse_euler(20, 21, None)),
        ("r_upper_arm", "r_clavicle", (0, 0, -lengths[13]), arm, _inverse_euler(22, 23, 24)),
        ("r_forearm", "r_upper_arm", (0, 0, -lengths[14]), np.eye(3),
         _inverse_euler(None, 25, None)),
        ("head", "thorax", neck, flip_x, _inverse_euler(28, 29, 30)),
    ]  # fmt: skip
    names = [entry[0] for entry in tree]
    return tuple(
        Bone(name, names.index(parent) if parent else -1, np.array(offset, float), rest, axes)
        for name, parent, offset, rest, axes in tree
    )


def _cones(parts: np.ndarray, lengths: np.ndarray, index: dict[str, int]) -> tuple[Cone, ...]:
    """Return ten elliptic cones along local +z (torso, legs, head) or -z (arms)."""
    ends = dict(
        zip(
            _PARTS,
            lengths[[0, 2, 3, 6, 7, 10, 11, 14, 15, 17]] * [1, 1, 1, 1, 1, -1, -1, -1, -1, 1],
            strict=True,
        )
    )
    return tuple(
        Cone(
            name,
            index["pelvis" if name == "torso" else name],
            np.zeros(3),
            np.array([0, 0, ends[name]]),
            (float(r0) * 1e-3, float(r1) * 1e-3),
            np.array([1.0, 0, 0]),
            (float(sx), float(sy)),
        )
        for name, (r0, r1, sx, sy) in zip(_PARTS, parts, strict=True)
    )


def _joints(lengths: np.ndarray, index: dict[str, int]) -> tuple[Joint, ...]:
    """Return the 15 joints, each at a height along its bone's z axis."""
    heights = [
        ("pelvis", "pelvis", 0.0), ("neck", "head", 0.0), ("head_top", "head", lengths[17]),
        ("l_shoulder", "l_upper_arm", 0.0), ("l_elbow", "l_forearm", 0.0),
        ("l_wrist", "l_forearm", -lengths[11]),
        ("r_shoulder", "r_upper_arm", 0.0), ("r_elbow", "r_forearm", 0.0),
        ("r_wrist", "r_forearm", -lengths[15]),
        ("l_hip", "l_thigh", 0.0), ("l_knee", "l_calf", 0.0), ("l_ankle", "l_calf", lengths[3]),
        ("r_hip", "r_thigh", 0.0), ("r_knee", "r_calf", 0.0), ("r_ankle", "r_calf", lengths[7]),
    ]  # fmt: skip
    return tuple(Joint(name, index[bone], np.array([0.0, 0.0, z])) for name, bone, z in heights)

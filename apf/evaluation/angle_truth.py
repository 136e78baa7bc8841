"""Joint angles of a track against those of true bone rotations, in degrees.

The truth's segments get anatomical frames in the same way as a body's (`apf.body.angles`): Y along
the limb, Z the axis about which elbow or knee bends, trunk and head upright at rest. That axis is
taken from the motion: the limbs of a rig at rest may be bent about another. So angles of both mean
the same up to a constant, where a rig's rest pose is not the person's upright one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from apf.body.angles import angles_between
from apf.evaluation.joint_names import EVALUATED_JOINTS, evaluated_joints
from apf.evaluation.truth import read_truth
from apf.tracking.track import Track

#: Names of the bones that carry the segments, of the CMU rigs and of `apf synth`.
_TRUNK = {
    "pelvis": ("Hips", "pelvis"),
    "thorax": ("Spine1", "thorax"),
    "head": ("Head", "head"),
}
#: Of each limb segment: the bones, without their side, and the joints that begin and end it.
_LIMBS = {
    "thigh": (("UpLeg", "thigh"), "hip", "knee"),
    "shank": (("Leg", "shin"), "knee", "ankle"),
    "upper_arm": (("Arm", "upper_arm"), "shoulder", "elbow"),
    "forearm": (("ForeArm", "forearm"), "elbow", "wrist"),
}
_SIDES = {"l_": ("Left", "l_"), "r_": ("Right", "r_")}
#: Angles of an arm that are undefined where it hangs; they are listed, but not in the mean.
UNDEFINED = ("plane_of_elevation", "axial_rotation")
#: The segments of a limb, and the sign of its bending: an arm bends forward, a leg backward.
_HINGES = (("upper_arm", "forearm", 1.0), ("thigh", "shank", -1.0))
#: Least mean sine of the angle between the segments of a limb for its axis to be known.
_BENT = 0.2


@dataclass(frozen=True)
class AngleError:
    """The error of an angle over the common frames, degrees: root mean square, and without the mean
    offset."""

    name: str
    rms: float
    free: float
    n_frames: int

    @property
    def defined(self) -> bool:
        """Whether the angle is defined in all poses."""
        return not self.name.endswith(UNDEFINED)


def _true_frames(bones: Mapping[str, np.ndarray], joints: np.ndarray) -> dict[str, np.ndarray]:
    """Return the world rotations (F, 3, 3) of the anatomical segments, as far as there are bones
    for them. joints: (F, 15, 3) m."""
    at = {name: joints[:, k] for k, name in enumerate(EVALUATED_JOINTS)}
    hips = _first(bones, _TRUNK["pelvis"])
    if hips is None:
        return {}
    left = _rest_direction(hips, at["l_hip"] - at["r_hip"]) * (1, 1, 0)
    left /= np.linalg.norm(left)
    up = np.array([0.0, 0, 1])
    upright = np.stack([np.cross(left, up), up, -left], -1)
    frames_of = {}
    for segment, names in _TRUNK.items():
        turned = _first(bones, names)
        if turned is not None:
            frames_of[segment] = turned @ upright
    for side, prefixes in _SIDES.items():
        frames_of |= _limb_frames(bones, at, side, prefixes, upright)
    return frames_of


def _limb_frames(
    bones: Mapping[str, np.ndarray],
    at: Mapping[str, np.ndarray],
    side: str,
    prefixes: tuple[str, ...],
    upright: np.ndarray,
) -> dict[str, np.ndarray]:
    """Return the frames (F, 3, 3) of the limbs of a side."""
    turned, vectors = {}, {}
    for segment, (names, begin, end) in _LIMBS.items():
        bone = _first(bones, [p + name for p, name in zip(prefixes, names, strict=True)])
        if bone is not None:
            turned[segment] = bone
            vectors[segment] = at[side + end] - at[side + begin]
    right = dict.fromkeys(turned, upright[:, 2])
    for near, far, sign in _HINGES:
        if {near, far} <= set(turned):
            along = [vectors[segment] for segment in (near, far)]
            along = [each / np.linalg.norm(each, axis=1, keepdims=True) for each in along]
            axis = sign * np.cross(*along)
            for segment in (near, far):
                mean = np.nanmean(np.einsum("fij,fi->fj", turned[segment], axis), axis=0)
                if np.linalg.norm(mean) > _BENT:
                    right[segment] = mean
    frames_of = {}
    for segment, rotation in turned.items():
        y = -_rest_direction(rotation, vectors[segment])
        z = right[segment] - (right[segment] @ y) * y
        z /= np.linalg.norm(z)
        frames_of[side + segment] = rotation @ np.stack([np.cross(y, z), y, z], -1)
    return frames_of


def _rest_direction(rotation: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the unit direction (3,) at rest of vectors (F, 3) that turn with a bone (F, 3, 3)."""
    mean: np.ndarray = np.nanmean(np.einsum("fij,fi->fj", rotation, vectors), axis=0)
    return mean / np.linalg.norm(mean)


def _first(bones: Mapping[str, np.ndarray], names: Any) -> np.ndarray | None:
    return next((bones[name] for name in names if name in bones), None)


def evaluate_angles(track: Track, path: Path) -> list[AngleError]:
    """Return the error of every angle that track and truth have in common frames; none for a track
    without a body, or a truth without rotations.

    path: an npz with bone_names (B,) and bone_rotations (F, B, 3, 3), each bone's rotation in the
    world from its rest pose, Z up, beside the joints. Raises InputError if it is invalid.
    """
    people, rotations = read_truth(path) if path.suffix.lower() == ".npz" else ({}, {})
    if not rotations or track.body is None:
        return []
    (series,) = people.values()
    joints, _, _ = evaluated_joints(series.joint_names, series.joints)
    angles = angles_between(_true_frames(rotations, joints))
    _, rows, true_rows = np.intersect1d(track.frames, series.frames, return_indices=True)
    errors = []
    for name, ours in track.angles.items():
        off = ours[rows] - angles[name][true_rows] if name in angles else np.zeros(0)
        off = (off[np.isfinite(off)] + 180) % 360 - 180
        if not off.size:
            continue
        # the mean of angles that may lie on both sides of half a turn
        mean = np.degrees(np.angle(np.exp(1j * np.radians(off)).mean()))
        rest = (off - mean + 180) % 360 - 180
        rms, free = (float(np.sqrt(np.mean(each**2))) for each in (off, rest))
        errors.append(AngleError(name, rms, free, int(off.size)))
    return errors


def mean_error(errors: Sequence[AngleError]) -> tuple[float, float]:
    """Return the mean over the angles that are always defined, degrees: with and without their
    offsets; NaN without any."""
    rows = [(error.rms, error.free) for error in errors if error.defined]
    if not rows:
        return float("nan"), float("nan")
    rms, free = np.mean(rows, axis=0)
    return float(rms), float(free)


def summarise_angles(errors: Sequence[AngleError]) -> dict[str, object]:
    """Return the figures for JSON; empty without errors."""
    if not errors:
        return {}
    rms, free = mean_error(errors)
    rows = [
        {
            "angle": error.name,
            "rms_deg": round(error.rms, 3),
            "offset_free_deg": round(error.free, 3),
            "n_frames": error.n_frames,
        }
        for error in errors
    ]
    return {"angle_rms_deg": round(rms, 3), "angle_offset_free_deg": round(free, 3), "angles": rows}

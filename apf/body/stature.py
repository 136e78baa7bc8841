"""The stature of the person that a body models."""

from __future__ import annotations

import numpy as np

from apf.body.kinematics import posed_cones, posed_joints
from apf.body.model import BodyModel
from cl import InputError

#: Height of the hips above the floor as a share of the stature (Drillis & Contini 1966).
HIP_SHARE = 0.53
TOP, HIPS, ANKLES = "head_top", "pelvis", ("l_ankle", "r_ankle")


def has_head(body: BodyModel) -> bool:
    """Return whether the body reaches up to the top of the head."""
    return TOP in body.joint_names


def has_feet(body: BodyModel) -> bool:
    """Return whether the body reaches down to the floor."""
    return any(name in body.joint_names for name in ANKLES)


def is_whole(body: BodyModel) -> bool:
    """Return whether the body reaches from the floor to the top of the head."""
    return has_head(body) and has_feet(body)


def lowest_point(cones: np.ndarray) -> float:
    """Return the z, m, of the lowest point of posed cones (C, 16)."""
    return float(min((cones[:, 2] - cones[:, 3]).min(), (cones[:, 6] - cones[:, 7]).min()))


def ankle_cones(body: BodyModel) -> dict[int, float]:
    """Return the cones that end at an ankle, by index, with the height, m, of their ends above the
    floor.

    The height is that of the upright body; empty for a body without feet.
    """
    cones = posed_cones(body, _upright(body))[0]
    places = posed_joints(body, _upright(body))[0]
    ankles = {}
    for joint, place in zip(body.joints, places, strict=True):
        leg = (joint.bone, body.bones[joint.bone].parent)
        rows = [c for c, cone in enumerate(body.cones) if cone.bone in leg]
        if joint.name in ANKLES and rows:
            away = [np.linalg.norm(cones[c, 4:7] - place) for c in rows]
            nearest = rows[int(np.argmin(away))]
            ankles[nearest] = float(cones[nearest, 6]) - lowest_point(cones)
    return ankles


def stature(body: BodyModel) -> float:
    """Return the height, m, of the upright person.

    Measured from the lowest cone to the top of the head. If the head or the feet are missing, it
    follows from the hips' height, `HIP_SHARE` of the stature. Raises InputError if the body lacks
    two of head, hips and feet.
    """
    pose = _upright(body)
    joints = dict(zip(body.joint_names, posed_joints(body, pose)[0, :, 2], strict=True))
    lowest = lowest_point(posed_cones(body, pose)[0])
    if is_whole(body):
        return float(joints[TOP] - lowest)
    if HIPS in joints and has_feet(body):
        return float(joints[HIPS] - lowest) / HIP_SHARE
    if HIPS in joints and has_head(body):
        return float(joints[TOP] - joints[HIPS]) / (1 - HIP_SHARE)
    raise InputError(
        f"the body {body.name} has the joints {', '.join(body.joint_names)}, which do not show how "
        f"tall the person is; expected two of {TOP}, {HIPS} and an ankle "
        f"({', '.join(ANKLES)})"
    )


def _upright(body: BodyModel) -> np.ndarray:
    """Return the pose (1, D) with all angles at 0, as far as the limits allow."""
    return np.clip(np.zeros(body.n_dof), body.lower, body.upper)[None]

"""Anatomical frames of a body's segments, as the International Society of Biomechanics defines
them.

Wu et al. 2002 and 2005: X forward, Y up (along a limb from its distal to its proximal end), Z to
the right. A limb's Z is the axis about which its knee or elbow bends. Pelvis, trunk and other
segments that are not limbs take their directions from the body standing upright with all angles at
0. A segment is found by the joint at its proximal end, so any body with these joint names works.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from apf.body.kinematics import bone_matrices, posed_joints
from apf.body.model import AXES, BodyModel

#: For each limb the joints that begin its two segments, the joint that ends it, and whether the
#: distal segment swings forward when it bends, as a forearm does.
_LIMBS = {
    "thigh": ("hip", "knee", "ankle", False),
    "upper_arm": ("shoulder", "elbow", "wrist", True),
}
_DISTAL_SEGMENTS = {"thigh": "shank", "upper_arm": "forearm"}


def anatomical_frames(body: BodyModel, poses: np.ndarray) -> dict[str, np.ndarray]:
    """Return world rotations (N, 3, 3), columns X, Y, Z as above, of poses (N, D), by segment.

    Segments are pelvis, thorax, head, and with l_ and r_ before them thigh, shank, foot, upper_arm
    and forearm, as far as `body` has them; a foot only if it is a bone of its own.
    """
    rotations, _ = bone_matrices(body, poses)
    return {
        name: rotations[:, bone] @ local for name, (bone, local) in segment_frames(body).items()
    }


@lru_cache
def segment_frames(body: BodyModel) -> dict[str, tuple[int, np.ndarray]]:
    """Return for each segment its bone and its anatomical frame (3, 3) in that bone's frame."""
    bone_of = {joint.name: joint.bone for joint in body.joints}
    upright, _ = bone_matrices(body, np.zeros((1, body.n_dof)))
    world = standing_axes(body)
    trunk = {"pelvis": bone_of.get("pelvis"), "head": bone_of.get("neck")}
    trunk["thorax"] = _common_ancestor(body, [bone_of.get("l_shoulder"), bone_of.get("r_shoulder")])
    frames = {
        name: (bone, upright[0, bone].T @ world) for name, bone in trunk.items() if bone is not None
    }
    for side in ("l_", "r_"):
        for near, (first, middle, end, forward) in _LIMBS.items():
            names = [side + first, side + middle, side + end]
            if not set(names) <= set(bone_of):
                continue
            axis = _hinge_axis(body, bone_of[names[1]], forward)
            for segment, top, bottom in ((near, *names[:2]), (_DISTAL_SEGMENTS[near], *names[1:])):
                bone = bone_of[top]
                right = upright[0, bone].T @ world[:, 2] if axis is None else axis[segment == near]
                frame = _build_frame(_joint_vector(body, bottom, top, bone), right)
                frames[side + segment] = (bone, frame)
        shank = frames.get(f"{side}shank", (-2,))[0]
        for bone in (index for index, child in enumerate(body.bones) if child.parent == shank):
            frames[f"{side}foot"] = (bone, upright[0, bone].T @ world)
    return frames


def standing_axes(body: BodyModel) -> np.ndarray:
    """Return columns forward, up, right (3, 3) of the body with all its angles at 0."""
    joints = posed_joints(body, np.zeros((1, body.n_dof)))[0]
    place = dict(zip(body.joint_names, joints, strict=True))
    for left, right in (("l_hip", "r_hip"), ("l_shoulder", "r_shoulder")):
        if {left, right, "pelvis", "neck"} <= set(place):
            return _build_frame(
                place["neck"] - place["pelvis"], place[right] - place[left], keep="right"
            )
    return np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # x forward, y left, z up


def _build_frame(up: np.ndarray, right: np.ndarray, keep: str = "up") -> np.ndarray:
    """Build the frame (3, 3), columns X, Y, Z, from directions that are not quite orthogonal.

    keep: "up": Y is exactly `up` and Z nearly `right`; "right": Z is exactly `right`.
    """
    if keep == "up":
        y = up / np.linalg.norm(up)
        z = right - (right @ y) * y
        z = z / np.linalg.norm(z)
    else:
        z = right / np.linalg.norm(right)
        y = up - (up @ z) * z
        y = y / np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z], -1)


def _joint_vector(body: BodyModel, start: str, end: str, bone: int) -> np.ndarray:
    """Return the vector (3,) between two joints in the frame of `bone`, to which both are fixed."""
    upright = np.zeros((1, body.n_dof))
    rotations, _ = bone_matrices(body, upright)
    at = dict(zip(body.joint_names, posed_joints(body, upright)[0], strict=True))
    return rotations[0, bone].T @ (at[end] - at[start])


def _hinge_axis(body: BodyModel, bone: int, forward: bool) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the axis to the right of a knee or elbow, the only rotation of `bone`.

    It is given in the frame of `bone` and in that of its parent; None unless `bone` has exactly one
    rotation.
    """
    turns = [axis for axis in body.bones[bone].axes if axis.kind[0] == "r"]
    if len(turns) != 1:
        return None
    dof = turns[0].dof
    lower, upper, bends = body.lower[dof], body.upper[dof], body.rest_pose[dof]
    if np.isfinite([lower, upper]).all() and lower + upper != 0:
        bends = lower + upper  # it bends towards the side that its limits allow
    sign = turns[0].sign * (1.0 if bends >= 0 else -1.0) * (1.0 if forward else -1.0)
    axis = np.zeros(3)
    axis[AXES.index(turns[0].kind) - 3] = sign
    return axis, body.bones[bone].rest @ axis


def _common_ancestor(body: BodyModel, bones: list[int | None]) -> int | None:
    """Return the nearest common ancestor of `bones`."""
    chains = []
    for bone in bones:
        chain = []
        while bone is not None and bone >= 0:
            bone = body.bones[bone].parent
            chain.append(bone)
        chains.append(chain)
    shared = [bone for bone in chains[0] if bone >= 0 and all(bone in c for c in chains)]
    return shared[0] if shared else None

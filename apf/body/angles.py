"""Clinical joint angles after the International Society of Biomechanics.

Hip, knee, ankle (Wu et al. 2002; Grood & Suntay 1983) and elbow (Wu et al. 2005) are Cardan angles
Z X' Y'' from the frame of the proximal segment to that of the distal one: flexion, adduction,
rotation. So are trunk, neck, and the shoulder's flexion, adduction, rotation. The shoulder also has
those of Wu et al. 2005, Y X' Y'' from thorax to upper arm: plane of elevation (0 abduction, 90
forward flexion), elevation, axial rotation; the first and the last are undefined for a hanging arm.
Pelvis: Y X' Z'' relative to the world, so that tilt and obliquity do not depend on the walking
direction (Baker 2001). Flexion, adduction, inversion and internal rotation are positive on both
sides.

The anatomical frames of segments have X forward, Y up (along a limb from its distal to its proximal
end) and Z to the right (Wu et al. 2002, 2005). A limb's Z is the axis about which its knee or elbow
bends. Pelvis, trunk and other segments that are not limbs take their directions from the body
standing upright with all angles at 0. A segment is found by the joint at its proximal end, so any
body with these joint names works.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import lru_cache

import numpy as np
import scipy

from apf.body.kinematics import bone_matrices, posed_joints
from apf.body.model import AXES, BodyModel
from psfs.common.numbers import FROM_Y_UP

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
    world, joints = standing_axes(body), standing_joints(body)
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
                along = upright[0, bone].T @ (joints[top] - joints[bottom])
                frames[side + segment] = (bone, _build_frame(along, right))
        shank = frames.get(f"{side}shank", (-2,))[0]
        for bone in (index for index, child in enumerate(body.bones) if child.parent == shank):
            frames[f"{side}foot"] = (bone, upright[0, bone].T @ world)
    return frames


def standing_joints(body: BodyModel) -> dict[str, np.ndarray]:
    """Return the joints (3,) m by name of the body with all its angles at 0."""
    joints = posed_joints(body, np.zeros((1, body.n_dof)))[0]
    return dict(zip(body.joint_names, joints, strict=True))


def standing_axes(body: BodyModel) -> np.ndarray:
    """Return columns forward, up, right (3, 3) of the body with all its angles at 0."""
    positions = standing_joints(body)
    for left, right in (("l_hip", "r_hip"), ("l_shoulder", "r_shoulder")):
        if {left, right, "pelvis", "neck"} <= set(positions):
            up = positions["neck"] - positions["pelvis"]
            return _build_frame(up, positions[right] - positions[left], keep="right")
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


#: Mirrors left segments, so that their angles have the same meaning as the right ones'.
_MIRROR = np.diag([1.0, 1.0, -1.0])
#: About Y.
_HALF_TURN = np.diag([-1.0, 1.0, -1.0])
#: Elevation, degrees, below which an arm's plane of elevation is undefined.
HANGING = 1.0
#: For each joint of a side: its proximal and distal segment, and the angles' names and signs.
_LIMB_JOINTS: dict[str, tuple[str, str, tuple[str, ...], tuple[int, int, int]]] = {
    "hip": ("pelvis", "thigh", ("flexion", "adduction", "rotation"), (1, 1, 1)),
    "knee": ("thigh", "shank", ("flexion",), (-1, 1, 1)),
    "ankle": ("shank", "foot", ("dorsiflexion", "inversion"), (1, 1, 1)),
    "shoulder": ("thorax", "upper_arm", ("flexion", "adduction", "rotation"), (1, 1, 1)),
    "elbow": ("upper_arm", "forearm", ("flexion",), (1, 1, 1)),
}


def joint_angles(body: BodyModel, poses: np.ndarray) -> dict[str, np.ndarray]:
    """Compute angles (N,), degrees, of poses (N, D), by clinical name; l_ and r_ mark the sides.

    A body has only the angles that its joints allow: without a foot joint no ankle angles (but see
    `standing_ankles`), without forearm rotation no pronation. No angle jumps by whole turns from
    one pose to the next. pelvis_rotation is counted from the world's x axis to the left;
    pelvis_obliquity is positive if the left side is higher. Plane of elevation and axial rotation
    are NaN if the arm hangs within `HANGING` degrees.
    """
    return angles_between(anatomical_frames(body, poses))


def angles_between(frames: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Compute the same angles from the world rotations (N, 3, 3) of anatomical segments, by name as
    of `anatomical_frames`."""
    angles: dict[str, np.ndarray] = {}
    if "pelvis" in frames:
        turned = decompose(FROM_Y_UP.T @ frames["pelvis"], "YXZ")
        names = ("rotation", "obliquity", "anterior_tilt")
        angles |= _name_angles("pelvis", names, turned, (1, 1, -1))
    names = ("flexion", "right_bending", "left_rotation")
    for joint, near, far in (("trunk", "pelvis", "thorax"), ("neck", "thorax", "head")):
        if {near, far} <= set(frames):
            angles |= _name_angles(
                joint, names, decompose(relative_rotations(frames, near, far), "ZXY"), (-1, 1, 1)
            )
    for side in ("l_", "r_"):
        angles |= _side_angles(frames, side)
    return angles


def standing_ankles(body: BodyModel, poses: np.ndarray, flat: np.ndarray) -> dict[str, np.ndarray]:
    """Compute the ankles' dorsiflexion (N,), degrees, of a body without foot joints.

    The foot is known only while it stands flat on a level floor: it is then level and points where
    the knee does. flat: (N, 2), whether the left and right foot do so in poses (N, D); NaN if not.
    """
    frames = anatomical_frames(body, poses)
    angles: dict[str, np.ndarray] = {}
    for column, side in enumerate(("l_", "r_")):
        shank = frames.get(f"{side}shank")
        if shank is None or f"{side}foot" in frames:
            continue
        right = shank[:, :, 2] * (1, 1, 0)
        right /= np.linalg.norm(right, axis=1, keepdims=True)
        up = np.broadcast_to([0.0, 0, 1], right.shape)
        foot = np.stack([np.cross(up, right), up, right], -1)
        turned = np.degrees(decompose(shank.transpose(0, 2, 1) @ foot, "ZXY")[:, 0])
        angles[f"{side}ankle_dorsiflexion"] = np.where(flat[:, column], turned, np.nan)
    return angles


def _side_angles(frames: Mapping[str, np.ndarray], side: str) -> dict[str, np.ndarray]:
    angles: dict[str, np.ndarray] = {}
    for joint, (near, far, names, signs) in _LIMB_JOINTS.items():
        start = near if near in ("pelvis", "thorax") else side + near
        if {start, side + far} <= set(frames):
            turned = decompose(relative_rotations(frames, start, side + far), "ZXY")
            angles |= _name_angles(side + joint, names, turned, signs)
    if {"thorax", f"{side}upper_arm"} <= set(frames):
        lifted = relative_rotations(frames, "thorax", f"{side}upper_arm")
        turned = decompose(_HALF_TURN @ lifted @ _HALF_TURN, "YXY")  # an arm is raised about -X'
        turned[turned[:, 1] < np.radians(HANGING)] *= (np.nan, 1, np.nan)
        names = ("plane_of_elevation", "elevation", "axial_rotation")
        angles |= _name_angles(f"{side}shoulder", names, turned)
    return angles


def _name_angles(
    joint: str, names: tuple[str, ...], turned: np.ndarray, signs: tuple[int, ...] = (1, 1, 1)
) -> dict[str, np.ndarray]:
    """Name the first columns of angles (N, 3), rad; return them unwrapped, in degrees."""
    degrees = np.degrees(unwrap_known(turned)) * signs + 0.0  # no -0
    return {f"{joint}_{name}": degrees[:, column] for column, name in enumerate(names)}


def unwrap_known(angles: np.ndarray) -> np.ndarray:
    """Return angles (N, K), rad, without jumps by whole turns; NaN stay, and are jumped over."""
    out = angles.copy()
    for column in out.T:
        known = np.isfinite(column)
        column[known] = np.unwrap(column[known])
    return out


def relative_rotations(frames: Mapping[str, np.ndarray], near: str, far: str) -> np.ndarray:
    """Return the rotations (N, 3, 3) from the frames of segment `near` to those of `far`.

    Those of a left segment are mirrored to the right side.
    """
    turned = frames[near].transpose(0, 2, 1) @ frames[far]
    return _MIRROR @ turned @ _MIRROR if far.startswith("l_") else turned


def decompose(rotations: np.ndarray, order: str) -> np.ndarray:
    """Decompose rotations (N, 3, 3) into angles (N, 3), rad, about axes that turn along, as "ZXY"
    names them: R = Rz Rx Ry. NaN stay."""
    angles = np.full((len(rotations), 3), np.nan)
    known = np.isfinite(rotations).all((1, 2))
    with warnings.catch_warnings():  # where two of the axes are one, the last angle is zero
        warnings.simplefilter("ignore")
        if known.any():
            turned = scipy.spatial.transform.Rotation.from_matrix(rotations[known])
            angles[known] = turned.as_euler(order)
    return angles


def rotation_between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the smallest rotation (3, 3) from the direction of `start` to that of `end`."""
    a, b = start / np.linalg.norm(start), end / np.linalg.norm(end)
    cross, cosine = np.cross(a, b), float(a @ b)
    if cosine < -1 + 1e-9:  # any perpendicular axis will do
        across = np.cross(a, np.eye(3)[np.abs(a).argmin()])
        across /= np.linalg.norm(across)
        return 2 * np.outer(across, across) - np.eye(3)
    skew = np.array([[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]])
    return np.eye(3) + skew + skew @ skew / (1 + cosine)

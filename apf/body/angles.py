"""Joint angles by their clinical names, after the International Society of Biomechanics.

Hip, knee, ankle (Wu et al. 2002; Grood & Suntay 1983) and elbow (Wu et al. 2005) are Cardan angles
Z X' Y'' from the frame of the near segment to that of the far one: flexion, adduction, rotation.
So are trunk, neck, and the shoulder's flexion, adduction, rotation. The shoulder has also those of
Wu et al. 2005, Y X' Y'' from thorax to upper arm: plane of elevation (0 abduction, 90 forward
flexion), elevation, axial rotation; the first and the last are not defined where the arm hangs.
Pelvis: Y X' Z'' against the world, so that tilt and obliquity do not depend on where the person
goes (Baker 2001). Flexion, adduction, inversion and internal rotation are positive on both sides.
"""

from __future__ import annotations

import numpy as np

from apf.body.anatomy import anatomical_frames
from apf.body.model import BodyModel

#: World axes, Z up, as the columns X, Y, Z of a frame that stands upright and faces along x.
WORLD = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
#: Left segments are mirrored: then their angles mean what the right ones' do.
_MIRROR = np.diag([1.0, 1.0, -1.0])
#: Degrees of elevation below which the direction of an arm from the trunk says nothing.
HANGING = 1.0
#: Of each joint of a side: its near and far segment, the angles' names and signs.
_LIMB_JOINTS: dict[str, tuple[str, str, tuple[str, ...], tuple[int, int, int]]] = {
    "hip": ("pelvis", "thigh", ("flexion", "adduction", "rotation"), (1, 1, 1)),
    "knee": ("thigh", "shank", ("flexion",), (-1, 1, 1)),
    "ankle": ("shank", "foot", ("dorsiflexion", "inversion"), (1, 1, 1)),
    "shoulder": ("thorax", "upper_arm", ("flexion", "adduction", "rotation"), (1, 1, 1)),
    "elbow": ("upper_arm", "forearm", ("flexion",), (1, 1, 1)),
}


def joint_angles(body: BodyModel, poses: np.ndarray) -> dict[str, np.ndarray]:
    """Return angles (N,), degrees, of poses (N, D), by clinical name; those of sides begin with l_
    and r_.

    Only what the body has: one whose feet do not bend has no angle of the ankle (but see
    `standing_ankles`), one whose forearms do not turn no pronation. pelvis_rotation counts from the
    world's x axis to the left, without jumps by whole turns; pelvis_obliquity is positive where the
    left side is higher. A plane of elevation and its axial rotation are NaN where the arm hangs
    within `HANGING` degrees.
    """
    frames = anatomical_frames(body, poses)
    angles: dict[str, np.ndarray] = {}
    if "pelvis" in frames:
        turned = yxz(WORLD.T @ frames["pelvis"])
        turned[:, 0] = np.unwrap(turned[:, 0])
        names = ("rotation", "obliquity", "anterior_tilt")
        angles |= _named("pelvis", names, turned, (1, 1, -1))
    names = ("flexion", "right_bending", "left_rotation")
    for joint, near, far in (("trunk", "pelvis", "thorax"), ("neck", "thorax", "head")):
        if {near, far} <= set(frames):
            angles |= _named(joint, names, zxy(relative(frames, near, far)), (-1, 1, 1))
    for side in ("l_", "r_"):
        angles |= _of_side(frames, side)
    return angles


def standing_ankles(body: BodyModel, poses: np.ndarray, flat: np.ndarray) -> dict[str, np.ndarray]:
    """Return the dorsiflexion (N,), degrees, of the ankles of a body whose feet do not bend, in
    poses (N, D) in which the left and the right foot stand flat on a level floor, `flat` (N, 2);
    else NaN. There the foot is known: it is level, and points where the knee does."""
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
        turned = np.degrees(zxy(shank.transpose(0, 2, 1) @ foot)[:, 0])
        angles[f"{side}ankle_dorsiflexion"] = np.where(flat[:, column], turned, np.nan)
    return angles


def _of_side(frames: dict[str, np.ndarray], side: str) -> dict[str, np.ndarray]:
    angles: dict[str, np.ndarray] = {}
    for joint, (near, far, names, signs) in _LIMB_JOINTS.items():
        start = near if near in ("pelvis", "thorax") else side + near
        if {start, side + far} <= set(frames):
            turned = zxy(relative(frames, start, side + far))
            angles |= _named(side + joint, names, turned, signs)
    if {"thorax", f"{side}upper_arm"} <= set(frames):
        turned = yxy(relative(frames, "thorax", f"{side}upper_arm"))
        turned[turned[:, 1] < np.radians(HANGING)] *= (np.nan, 1, np.nan)
        names = ("plane_of_elevation", "elevation", "axial_rotation")
        angles |= _named(f"{side}shoulder", names, turned)
    return angles


def _named(
    joint: str, names: tuple[str, ...], turned: np.ndarray, signs: tuple[int, ...] = (1, 1, 1)
) -> dict[str, np.ndarray]:
    """Return degrees by name of the first of angles (N, 3), rad."""
    degrees = np.degrees(turned) * signs + 0.0  # no -0
    return {f"{joint}_{name}": degrees[:, column] for column, name in enumerate(names)}


def relative(frames: dict[str, np.ndarray], near: str, far: str) -> np.ndarray:
    """Return the rotations (N, 3, 3) from the frames of segment `near` to those of `far`, mirrored
    to the right side where `far` is a left one."""
    turned = frames[near].transpose(0, 2, 1) @ frames[far]
    return _MIRROR @ turned @ _MIRROR if far.startswith("l_") else turned


def zxy(rotations: np.ndarray) -> np.ndarray:
    """Return (N, 3) angles, rad, about Z, X' and Y'': R = Rz Rx Ry."""
    r = rotations
    about_x = np.arcsin(np.clip(r[:, 2, 1], -1, 1))
    return np.stack(
        [np.arctan2(-r[:, 0, 1], r[:, 1, 1]), about_x, np.arctan2(-r[:, 2, 0], r[:, 2, 2])], -1
    )


def yxz(rotations: np.ndarray) -> np.ndarray:
    """Return (N, 3) angles, rad, about Y, X' and Z'': R = Ry Rx Rz."""
    r = rotations
    about_x = np.arcsin(np.clip(-r[:, 1, 2], -1, 1))
    return np.stack(
        [np.arctan2(r[:, 0, 2], r[:, 2, 2]), about_x, np.arctan2(r[:, 1, 0], r[:, 1, 1])], -1
    )


def yxy(rotations: np.ndarray) -> np.ndarray:
    """Return (N, 3) angles, rad, about Y, X' and Y'', the second from 0 to pi the other way round:
    R = Ry(a) Rx(-b) Ry(c)."""
    r = rotations
    elevation = np.arccos(np.clip(r[:, 1, 1], -1, 1))
    return np.stack(
        [np.arctan2(-r[:, 0, 1], -r[:, 2, 1]), elevation, np.arctan2(-r[:, 1, 0], r[:, 1, 2])], -1
    )

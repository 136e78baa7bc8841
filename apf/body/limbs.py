"""Trunk and limbs of a body, found from the structure of its bones, without their names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from apf.body.jacobian import bone_point_jacobian
from apf.body.kinematics import posed_joints, posed_points
from apf.body.model import BodyModel, Bone, FreeAxis

#: The joints at the ends of a person's limbs and head.
LIMB_ENDS = {
    "left arm": "l_wrist",
    "right arm": "r_wrist",
    "left leg": "l_ankle",
    "right leg": "r_ankle",
    "head": "head_top",
}
#: Default tolerance, m: joints that are nearer to their targets are not moved.
_TOLERANCE = 0.02
#: Number of Levenberg steps towards the targets, and their damping, m^2 / rad^2.
_N_STEPS, _DAMPING = 3, 1e-3
#: The axes of an ankle, rad: limits (40 degrees of dorsiflexion under the body weight, Bennell et
#: al. 1998; 50 of plantar flexion; toes 30 degrees in or out), change from one frame to the
#: next, as a knee's, and spread of people's postures.
_ANKLE = {"ry": (-0.7, 0.87, 0.045, 0.3), "rz": (-0.5, 0.5, 0.025, 0.15)}
#: Words in the names of a limb's angles.
_ANGLES = {"arm": {"shoulder", "arm", "elbow"}, "leg": {"hip", "knee", "ankle"}}


def trunk_bones(body: BodyModel) -> list[int]:
    """Return the bones below which the body branches."""
    children = _children(body)
    branches = [False] * len(body.bones)
    for bone in reversed(range(len(body.bones))):  # children come after their parents
        branches[bone] = len(children[bone]) > 1 or any(branches[c] for c in children[bone])
    return [bone for bone, branching in enumerate(branches) if branching]


def trunk_mask(body: BodyModel) -> np.ndarray:
    """Return (D,) bool: the degrees of freedom of the `trunk_bones`."""
    return _dof_mask(body, trunk_bones(body))


def root_mask(body: BodyModel) -> np.ndarray:
    """Return (D,) bool: the degrees of freedom of the bones without a parent."""
    return _dof_mask(body, [bone for bone, each in enumerate(body.bones) if each.parent < 0])


def limb_chains(body: BodyModel) -> list[tuple[int, ...]]:
    """Return the bones of each limb, from the trunk to its end.

    A limb is an unbranched chain of two or more bones that ends without children, and whose parent
    has several children.
    """
    children = _children(body)
    chains = []
    for first in (child for siblings in children if len(siblings) > 1 for child in siblings):
        chain = [first]
        while len(children[chain[-1]]) == 1:
            chain += children[chain[-1]]
        if len(chain) > 1 and not children[chain[-1]]:
            chains.append(tuple(chain))
    return chains


def limb_masks(body: BodyModel) -> np.ndarray:
    """Return (L, D) bool: the degrees of freedom of each of the `limb_chains`."""
    masks = [_dof_mask(body, chain) for chain in limb_chains(body)]
    return np.array(masks, bool).reshape(-1, body.n_dof)


def limb_names(body: BodyModel) -> tuple[str, ...]:
    """Return the usual names (L,) of the `limb_chains`, such as left arm."""
    ends = {joint.bone: joint.name for joint in body.joints if joint.name in LIMB_ENDS.values()}
    names = {end: name for name, end in LIMB_ENDS.items()}
    listed = []
    for chain in limb_chains(body):
        end = next((ends[bone] for bone in chain if bone in ends), None)
        listed.append(names[end] if end else body.bones[chain[-1]].name)
    return tuple(listed)


def limb_ends(body: BodyModel) -> list[int]:
    """Return the index of the last joint on each of the `limb_chains`; 0 for one without joints."""
    ends = []
    for chain in limb_chains(body):
        on_it = [number for number, joint in enumerate(body.joints) if joint.bone in chain]
        ends.append(on_it[-1] if on_it else 0)
    return ends


def limb_bones(body: BodyModel) -> np.ndarray:
    """Return (L, B) bool: the bones of each of the `limb_chains`."""
    bones = np.zeros((len(limb_chains(body)), len(body.bones)), bool)
    for limb, chain in enumerate(limb_chains(body)):
        bones[limb, list(chain)] = True
    return bones


def arm_cones(body: BodyModel) -> list[list[int]]:
    """Return the cones of each arm, from the shoulder to the hand."""
    arms = [name.endswith("arm") for name in limb_names(body)]
    return [
        [number for number, cone in enumerate(body.cones) if bones[cone.bone]]
        for bones in limb_bones(body)[arms]
    ]


def find_hands(body: BodyModel) -> list[int]:
    """Return the cones at whose ends are the hands that hold what the person carries before the
    trunk, the last one of each arm; none without that, as what is on the back is worn."""
    load = body.cones[len(body.without_load.cones) :]
    if not load or np.mean([cone.start[0] for cone in load]) <= 0:
        return []
    return [cones[-1] for cones in arm_cones(body) if cones]


def limb_joints(body: BodyModel) -> np.ndarray:
    """Return (L, J) bool: the joints that each of the `limb_chains` moves.

    Its first joint, such as a hip, is moved by its parent.
    """
    joints = limb_bones(body)[:, [joint.bone for joint in body.joints]]
    for limb, chain in enumerate(limb_chains(body)):
        for number, joint in enumerate(body.joints):
            if joint.bone == chain[0] and not np.any(joint.position):
                joints[limb, number] = False
    return joints


def solve_inverse_kinematics(
    body: BodyModel,
    poses: np.ndarray,
    dofs: np.ndarray,
    joints: np.ndarray,
    places: np.ndarray,
    near: float = _TOLERANCE,
) -> np.ndarray:
    """Move `joints` to `places` by a few damped steps of inverse kinematics (Levenberg 1944).

    dofs: free degrees of freedom, (D,) or (N, D) bool. joints: (J,) or (N, J) bool. places: target
    positions (N, J, 3) m. near: tolerance, m. Returns poses (N, D). Poses whose joints are within
    the tolerance, or that the steps do not improve, are unchanged.

    Positions are needed where the trunk differs: a limb's angles are relative to its own trunk, and
    a few degrees of the chest move a hand far.
    """
    poses, joints = poses.copy(), np.broadcast_to(joints, places.shape[:2])
    off = np.linalg.norm(posed_joints(body, poses) - places, axis=-1)
    far = np.flatnonzero(np.any(joints & (off > near), axis=1))
    if not far.size:
        return poses
    moved, free = poses[far], np.broadcast_to(dofs, poses.shape)[far]
    compared = np.any(joints[far], axis=0)
    wanted, goals = joints[far][:, compared, None, None], places[far][:, compared]
    bones = np.array([joint.bone for joint in body.joints])[compared]
    n_free = free.sum(1).max()
    each = np.argsort(~free, axis=1, kind="stable")[:, :n_free]  # the free ones of each pose
    axes = np.zeros((2, *moved.shape, 3))
    for _ in range(_N_STEPS):
        now = posed_points(body, moved, body.joints, axes)[:, compared]
        slopes = bone_point_jacobian(body, moved, bones, now, axes) * free[:, None, :, None]
        slopes = wanted * np.take_along_axis(slopes, each[:, None, :, None], 2)
        rows = slopes.swapaxes(1, 2).reshape(len(moved), n_free, -1)
        matrix = rows @ rows.swapaxes(1, 2) + _DAMPING * np.eye(n_free)
        gap = rows @ (now - goals).reshape(len(moved), -1, 1)
        steps = np.zeros_like(moved)
        np.put_along_axis(steps, each, np.linalg.solve(matrix, gap)[..., 0], 1)
        moved = np.where(free, np.clip(moved - steps, body.lower, body.upper), moved)
    moved_off = np.linalg.norm(posed_joints(body, moved) - places[far], axis=-1)
    nearer = np.sum(joints[far] * moved_off, 1) < np.sum(joints[far] * off[far], 1)
    poses[far] = np.where(nearer[:, None], moved, poses[far])
    return poses


def limb_angles(body: BodyModel, names: Iterable[str]) -> np.ndarray:
    """Return (L, N) bool: which angles belong to each of the `limb_chains`.

    names: of the N angles, such as l_knee_flexion or knee_angle_l.
    """
    tokens = [set(name.split("_")) for name in names]
    moved = np.zeros((len(limb_chains(body)), len(tokens)), bool)
    for limb, name in enumerate(limb_names(body)):
        side, _, kind = name.partition(" ")
        if kind in _ANGLES:
            moved[limb] = [side[0] in words and bool(_ANGLES[kind] & words) for words in tokens]
    return moved


def add_ankles(body: BodyModel) -> BodyModel:
    """Return the body with feet that turn about its ankles: each cone `foot` becomes a bone, whose
    angles are the last degrees of freedom. A body without ankles, or with such bones, is returned
    as it is."""
    bones, cones, axes = list(body.bones), list(body.cones), list[FreeAxis]()
    joints = {joint.name: joint for joint in body.joints}
    for side in ("l_", "r_"):
        ankle, name = joints.get(f"{side}ankle"), f"{side}foot"
        parts = [number for number, cone in enumerate(body.cones) if cone.name == name]
        if ankle is None or not parts or any(bone.name == name for bone in bones):
            continue
        turns = tuple(
            FreeAxis(kind, 1, body.n_dof + len(axes) + number) for number, kind in enumerate(_ANKLE)
        )
        bones.append(Bone(name, ankle.bone, ankle.position, np.eye(3), turns))
        axes += turns
        joints[ankle.name] = replace(ankle, bone=len(bones) - 1, position=np.zeros(3))
        for number in parts:
            start, end = (end - ankle.position for end in (cones[number].start, cones[number].end))
            cones[number] = replace(cones[number], bone=len(bones) - 1, start=start, end=end)
    names = [f"{bone.name}.{axis.kind}" for bone in bones[len(body.bones) :] for axis in bone.axes]
    lower, upper, sigma, posture = np.array([_ANKLE[axis.kind] for axis in axes]).reshape(-1, 4).T
    nothing = np.zeros(len(axes))
    return replace(
        body,
        bones=tuple(bones),
        cones=tuple(cones),
        joints=tuple(joints.values()),
        dof_names=(*body.dof_names, *names),
        lower=np.concatenate([body.lower, lower]),
        upper=np.concatenate([body.upper, upper]),
        sigma=np.concatenate([body.sigma, sigma]),
        rest_pose=np.concatenate([body.rest_pose, nothing]),
        posture_sigma=np.concatenate([body.posture_sigma, posture]),
        posture_rise=np.concatenate([body.posture_rise, nothing]),
    )


def _children(body: BodyModel) -> list[list[int]]:
    """Return the children of each bone."""
    children: list[list[int]] = [[] for _ in body.bones]
    for index, bone in enumerate(body.bones):
        if bone.parent >= 0:
            children[bone.parent].append(index)
    return children


def _dof_mask(body: BodyModel, bones: Iterable[int]) -> np.ndarray:
    """Return (D,) bool: the degrees of freedom of these bones."""
    mask = np.zeros(body.n_dof, bool)
    mask[[axis.dof for bone in bones for axis in body.bones[bone].axes]] = True
    return mask

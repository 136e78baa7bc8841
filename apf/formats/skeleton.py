"""Convert a body to a skeleton of named nodes, for animation files (BVH, GLB).

World: metres, Y up, (X, Y, Z) = world (x, z, -y), so that Blender, which converts Y up to Z up,
shows the person where the tracker saw them. In the rest attitude, where all rotations are the
identity, the body stands upright with its arms out to the sides and faces along Z, as MotionBuilder
requires. Nodes have the names that animation programs use: Hips, Spine, LeftArm, LeftForeArm,
LeftHand, ...
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from apf.body.angles import rotation_between, standing_axes, standing_joints
from apf.body.kinematics import bone_matrices
from apf.body.markers import virtual_markers
from apf.body.model import BodyModel, Joint, find_side, sideless
from psfs.common.numbers import FROM_Y_UP

#: From the tracker's world to the files': (x, y, z) -> (x, z, -y).
TO_Y_UP = FROM_Y_UP.T
_NAMES = {
    "pelvis": "Hips", "thorax": "Spine", "head": "Head", "head_top": "HeadTop",
    "clavicle": "Shoulder", "upper_arm": "Arm", "forearm": "ForeArm", "wrist": "Hand",
    "hand": "HandEnd", "thigh": "UpLeg", "calf": "Leg", "ankle": "Foot", "toe": "ToeBase",
}  # fmt: skip
#: Markers whose parent is a joint of their bone, and that joint.
_HOLDERS = {"hand": "wrist", "toe": "ankle"}


@dataclass(frozen=True, eq=False)
class Node:
    """A node of the skeleton.

    parent: index, -1 for a root. offset: (3,) m from the parent in the rest attitude. bone: its
    index, None for a point that is fixed to its parent.
    """

    name: str
    parent: int
    offset: np.ndarray
    bone: int | None = None


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A tree of nodes with its rest attitude.

    nodes: depth first, parents before children. rest: (B, 3, 3) rotations from the bones' frames to
    the rest attitude.
    """

    nodes: tuple[Node, ...]
    rest: np.ndarray

    def children(self, index: int) -> list[int]:
        """Return the indices of a node's children."""
        return [child for child, node in enumerate(self.nodes) if node.parent == index]

    def places(self) -> np.ndarray:
        """Return the positions (N, 3) m of the nodes in the rest attitude."""
        places: list[np.ndarray] = []
        for node in self.nodes:
            places.append(node.offset + (places[node.parent] if node.parent >= 0 else 0))
        return np.array(places)

    def bind(
        self, body: BodyModel, pose: np.ndarray, bones: Sequence[int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return origins (J, 3) m and rotations (J, 3, 3) of the nodes of `bones` in a `pose`."""
        rotations, origins = (values[0, list(bones)] for values in bone_matrices(body, pose[None]))
        turned = TO_Y_UP @ rotations @ self.rest[list(bones)].transpose(0, 2, 1)
        return origins @ TO_Y_UP.T, turned

    def motion(self, body: BodyModel, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rotations (F, N, 3, 3) and positions (F, N, 3) m of the nodes relative to their
        parents.

        Roots are relative to the world. poses: (F, D).
        """
        rotations, origins = bone_matrices(body, poses)
        turned = TO_Y_UP @ rotations @ self.rest.transpose(0, 2, 1)
        placed = origins @ TO_Y_UP.T
        local = np.broadcast_to(np.eye(3), (len(turned), len(self.nodes), 3, 3)).copy()
        shifts = np.broadcast_to([node.offset for node in self.nodes], (*local.shape[:2], 3)).copy()
        for index, node in enumerate(self.nodes):
            if node.bone is None:
                continue
            parent = body.bones[node.bone].parent
            if parent < 0:
                local[:, index], shifts[:, index] = turned[:, node.bone], placed[:, node.bone]
                continue
            back = turned[:, parent].transpose(0, 2, 1)
            local[:, index] = back @ turned[:, node.bone]
            away = placed[:, node.bone] - placed[:, parent]
            shifts[:, index] = np.einsum("fab,fb->fa", back, away)
        return local, shifts


def build_skeleton(body: BodyModel) -> Skeleton:
    """Build the skeleton of `body`: bones, joints that are not at a bone's origin, toes and
    hands."""
    rest, nodes = _rest_attitude(body), list[Node]()
    markers = [marker for marker in virtual_markers(body) if sideless(marker.name) in _HOLDERS]

    def add_point(point: Joint, parent: int, offset: np.ndarray) -> int:
        name = node_name(point.name)
        name += "Joint" * any(name == node.name for node in nodes)  # beside its bone
        nodes.append(Node(name, parent, rest[point.bone] @ offset))
        return len(nodes) - 1

    def add_bone(index: int, parent: int) -> None:
        bone, bone_node = body.bones[index], len(nodes)
        offset = np.zeros(3) if bone.parent < 0 else rest[bone.parent] @ bone.offset
        nodes.append(Node(node_name(bone.name), parent, offset, index))
        for joint in body.joints:
            if joint.bone != index:
                continue
            node = bone_node
            if np.linalg.norm(joint.position) >= 1e-9:
                node = add_point(joint, bone_node, joint.position)
            for marker in markers:
                side = marker.name.removesuffix(sideless(marker.name))
                if marker.bone == index and side + _HOLDERS[sideless(marker.name)] == joint.name:
                    add_point(marker, node, marker.position - joint.position)
        for child, below in enumerate(body.bones):
            if below.parent == index:
                add_bone(child, bone_node)

    for index, bone in enumerate(body.bones):
        if bone.parent < 0:
            add_bone(index, -1)
    return Skeleton(tuple(nodes), rest)


def _rest_attitude(body: BodyModel) -> np.ndarray:
    """Return (B, 3, 3) rotations from the bones' frames to the rest attitude.

    There the body has all its angles at 0 and its arms turned outwards, facing along Z with Y up.
    """
    rotations = bone_matrices(body, np.zeros((1, body.n_dof)))[0][0].copy()
    forward, up, right = standing_axes(body).T
    joints = standing_joints(body)
    for side, outwards in (("l", -right), ("r", right)):
        shoulder, elbow = f"{side}_shoulder", f"{side}_elbow"
        if {shoulder, elbow} <= set(joints):
            turn = rotation_between(joints[elbow] - joints[shoulder], outwards)
            arm = {body.joints[body.joint_names.index(shoulder)].bone}
            for index, bone in enumerate(body.bones):  # parents come first
                if index in arm or bone.parent in arm:
                    arm.add(index)
                    rotations[index] = turn @ rotations[index]
    return np.stack([-right, up, forward]) @ rotations


def node_name(name: str) -> str:
    """Return the name of a bone, joint or marker in animation files."""
    plain = sideless(name)
    side = "" if plain == name else find_side(name).capitalize()
    return side + _NAMES.get(plain, "".join(word.capitalize() for word in plain.split("_")))

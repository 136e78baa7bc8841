"""The synthetic person's skeleton: bones, rest offsets, forward kinematics, truth joints.

Body axes at rest: x forward, y left, z up; standing, arms hanging. Every bone's rotation is the
identity at rest. Lengths are shares of the stature (after Drillis & Contini 1966).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

THIGH, SHIN, ANKLE_HEIGHT = 0.243, 0.244, 0.045
UPPER_ARM, FOREARM = 0.172, 0.150
BALL_FORWARD, BALL_HEIGHT = 0.075, 0.015
HEEL_BACK, HEEL_RADIUS = 0.017, 0.0205

#: bone -> (parent, offset of its origin from the parent's origin at rest, shares of stature)
_TRUNK: dict[str, tuple[str, tuple[float, float, float]]] = {
    "pelvis": ("", (0.0, 0.0, 0.0)),
    "spine": ("pelvis", (0.0, 0.0, 0.060)),
    "thorax": ("spine", (0.0, 0.0, 0.100)),
    "neck": ("thorax", (-0.005, 0.0, 0.130)),
    "head": ("neck", (0.010, 0.0, 0.055)),
}
_SIDE: dict[str, tuple[str, tuple[float, float, float]]] = {
    "upper_arm": ("thorax", (-0.005, 0.103, 0.106)),
    "forearm": ("_upper_arm", (0.0, 0.0, -UPPER_ARM)),
    "hand": ("_forearm", (0.0, 0.0, -FOREARM)),
    "thigh": ("pelvis", (0.0, 0.052, 0.0)),
    "shin": ("_thigh", (0.0, 0.0, -THIGH)),
    "foot": ("_shin", (0.0, 0.0, -SHIN)),
    "toes": ("_foot", (BALL_FORWARD, 0.0, BALL_HEIGHT - ANKLE_HEIGHT)),
}
#: joint -> (bone, point in the bone's frame, shares of stature)
_TRUNK_JOINTS: dict[str, tuple[str, tuple[float, float, float]]] = {
    "pelvis": ("pelvis", (0.0, 0.0, 0.0)),
    "spine": ("spine", (0.0, 0.0, 0.0)),
    "thorax": ("thorax", (0.0, 0.0, 0.0)),
    "neck": ("neck", (0.0, 0.0, 0.0)),
    "head": ("head", (0.0, 0.0, 0.0)),
    "head_top": ("head", (0.008, 0.0, 0.123)),
}
_SIDE_JOINTS: dict[str, tuple[str, tuple[float, float, float]]] = {
    "shoulder": ("upper_arm", (0.0, 0.0, 0.0)),
    "elbow": ("forearm", (0.0, 0.0, 0.0)),
    "wrist": ("hand", (0.0, 0.0, 0.0)),
    "hand": ("hand", (0.0, 0.0, -0.050)),
    "hip": ("thigh", (0.0, 0.0, 0.0)),
    "knee": ("shin", (0.0, 0.0, 0.0)),
    "ankle": ("foot", (0.0, 0.0, 0.0)),
    "toe": ("toes", (0.0, 0.0, 0.0)),
    "toe_tip": ("toes", (0.033, 0.0, 0.0)),
}


@dataclass(frozen=True, eq=False)
class Motion:
    """World placement of all bones: rotations (F, B, 3, 3), positions (F, B, 3) m."""

    rotations: np.ndarray
    positions: np.ndarray


class SyntheticSkeleton:
    """Bones of a person of the given stature (m), parents before children.

    bones: names. parents: (B,) int, -1 for the root. offsets: (B, 3) m. joint_names: names of the
    truth joints.
    """

    def __init__(self, height: float) -> None:
        self.height = height
        table = dict(_TRUNK)
        joints = dict(_TRUNK_JOINTS)
        for side, sign in (("l", 1.0), ("r", -1.0)):
            for bone, (parent, (x, y, z)) in _SIDE.items():
                parent = side + parent if parent.startswith("_") else parent
                table[f"{side}_{bone}"] = (parent, (x, sign * y, z))
            for joint, (bone, point) in _SIDE_JOINTS.items():
                joints[f"{side}_{joint}"] = (f"{side}_{bone}", point)
        self.bones = list(table)
        self.parents = np.array([self.bones.index(p) if p else -1 for p, _ in table.values()])
        self.offsets = height * np.array([offset for _, offset in table.values()])
        self.joint_names = list(joints)
        self._joint_bones = [self.bones.index(bone) for bone, _ in joints.values()]
        self._joint_points = height * np.array([point for _, point in joints.values()])

    def index(self, bone: str) -> int:
        return self.bones.index(bone)

    def forward(self, root: np.ndarray, local: dict[str, np.ndarray]) -> Motion:
        """Compute forward kinematics.

        root: (F, 3) pelvis position, m. local: bone -> (F, 3, 3) rotation relative to its parent;
        identity for bones that are not named.
        """
        count = len(root)
        rotations = np.empty((count, len(self.bones), 3, 3))
        positions = np.empty((count, len(self.bones), 3))
        for i, bone in enumerate(self.bones):
            turn = local.get(bone, np.broadcast_to(np.eye(3), (count, 3, 3)))
            parent = self.parents[i]
            if parent < 0:
                rotations[:, i], positions[:, i] = turn, root
            else:
                rotations[:, i] = rotations[:, parent] @ turn
                positions[:, i] = positions[:, parent] + rotations[:, parent] @ self.offsets[i]
        return Motion(rotations, positions)

    def joints(self, motion: Motion) -> np.ndarray:
        """Return the truth joints (F, J, 3) m, in the order of `joint_names`."""
        turned = np.einsum(
            "fjab,jb->fja", motion.rotations[:, self._joint_bones], self._joint_points
        )
        return motion.positions[:, self._joint_bones] + turned

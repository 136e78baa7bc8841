"""The body model as data: a tree of bones with free axes, tapered cones and named joints.

World matrix of a bone (Rymut 2016 eq. 4.18-4.21): W = W_parent T(offset) rest A_1 A_2 ..., where
each free axis A is a translation along or a rotation about a local axis. The pose is the vector of
all axis values (metres, radians).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

#: Kinds of free axes: translations along and rotations about x, y, z.
AXES = ("tx", "ty", "tz", "rx", "ry", "rz")
#: Beginning of the names of the cones of what a person carries. They come last.
LOAD = "load"


@dataclass(frozen=True)
class FreeAxis:
    """A degree of freedom.

    kind: one of AXES. sign: +1 or -1. dof: its index in the pose.
    """

    kind: str
    sign: int
    dof: int


@dataclass(frozen=True, eq=False)
class Bone:
    """A link of the body's tree.

    offset: (3,) m from the parent's origin in the parent's frame. rest: (3, 3) rotation.
    """

    name: str
    parent: int  # -1 for a root
    offset: np.ndarray
    rest: np.ndarray
    axes: tuple[FreeAxis, ...]


@dataclass(frozen=True, eq=False)
class Cone:
    """A tapered cylinder fixed to a bone: end centres (3,) m and radii m in the bone's frame.

    Its section is an ellipse: the radius is scaled by `scale` along `side` and along axis x side.
    in_images: False for a part that only explains voxels near it (such as a foot); it is neither
    compared with the images by the likelihood.
    """

    name: str
    bone: int
    start: np.ndarray
    end: np.ndarray
    radii: tuple[float, float]
    side: np.ndarray
    scale: tuple[float, float]
    in_images: bool = True


@dataclass(frozen=True, eq=False)
class Joint:
    """A named point (3,) m in a bone's frame."""

    name: str
    bone: int
    position: np.ndarray


@dataclass(frozen=True, eq=False)
class BodyModel:
    """Bones (parents first), cones, joints, and the limits and noise of each degree of freedom.

    dof_names: (D,). lower, upper: (D,) limits, infinite where free. sigma: (D,) standard deviation
    of the change from one frame to the next at 60 frames/s. rest_pose: (D,) standing.
    posture_sigma: (D,) standard deviation from rest of the posture prior; infinite for a flat one.
    posture_rise: (D,) by how much the posture prior's mean rises from rest where the child of the
    axis' bone points up, see `posture_means`; 0 where it stays at rest.
    edges: joint pairs to draw. apart: pairs of cones that must not overlap.
    """

    name: str
    bones: tuple[Bone, ...]
    cones: tuple[Cone, ...]
    joints: tuple[Joint, ...]
    dof_names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    sigma: np.ndarray
    rest_pose: np.ndarray
    posture_sigma: np.ndarray
    posture_rise: np.ndarray
    edges: tuple[tuple[int, int], ...]
    apart: tuple[tuple[int, int], ...] = ()

    @property
    def n_dof(self) -> int:
        return len(self.dof_names)

    @property
    def limits(self) -> np.ndarray:
        """Lower and upper limits (D, 2) float32, as the kernels take them."""
        return np.stack([self.lower, self.upper], -1).astype(np.float32)

    @property
    def angles(self) -> list[int]:
        """Indices in the pose of the rotations, rad."""
        return [axis.dof for bone in self.bones for axis in bone.axes if axis.kind[0] == "r"]

    @property
    def lifted_bones(self) -> np.ndarray:
        """Bones (D,) with whose lift the posture prior's mean rises: the child of the axis' bone;
        -1 where it does not rise."""
        lifted = np.full(self.n_dof, -1)
        for number, child in enumerate(self.bones):
            if child.parent >= 0:
                rising = [axis.dof for axis in self.bones[child.parent].axes]
                lifted[[dof for dof in rising if self.posture_rise[dof]]] = number
        return lifted

    @property
    def joint_names(self) -> list[str]:
        return [joint.name for joint in self.joints]

    @property
    def cone_names(self) -> list[str]:
        return [cone.name for cone in self.cones]

    @property
    def scale_groups(self) -> list[str]:
        """Names of the bones that are scaled together: left and right share one."""
        return list(dict.fromkeys(sideless(bone.name) for bone in self.bones))

    @property
    def radius_groups(self) -> list[str]:
        """Names of the cones whose radii are scaled together: left and right share one."""
        return list(dict.fromkeys(sideless(cone.name) for cone in self.cones))

    @property
    def without_load(self) -> BodyModel:
        """The body without what the person carries."""
        cones = tuple(cone for cone in self.cones if not cone.name.startswith(LOAD))
        if len(cones) == len(self.cones):
            return self
        apart = tuple(pair for pair in self.apart if max(pair) < len(cones))
        return replace(self, cones=cones, apart=apart)

    def scaled(
        self, lengths: Mapping[str, float], radii: float | Mapping[str, float] = 1.0
    ) -> BodyModel:
        """Scale what is fixed to each bone: children's offsets, cones, joints.

        lengths: factor per scale group, 1 where absent. radii: factor for all cone radii, or per
        radius group, 1 where absent.
        """
        if not isinstance(radii, Mapping):
            radii = dict.fromkeys(self.radius_groups, radii)
        width = [radii.get(sideless(cone.name), 1.0) for cone in self.cones]
        factor = [lengths.get(sideless(bone.name), 1.0) for bone in self.bones]
        bones = tuple(
            bone if bone.parent < 0 else replace(bone, offset=bone.offset * factor[bone.parent])
            for bone in self.bones
        )
        cones = tuple(
            replace(
                cone,
                start=cone.start * factor[cone.bone],
                end=cone.end * factor[cone.bone],
                radii=(cone.radii[0] * girth, cone.radii[1] * girth),
            )
            for cone, girth in zip(self.cones, width, strict=True)
        )
        joints = tuple(replace(j, position=j.position * factor[j.bone]) for j in self.joints)
        return replace(self, bones=bones, cones=cones, joints=joints)


def sideless(name: str) -> str:
    """Return the name of a bone, cone or joint without its side; left and right share one."""
    return name.removeprefix("l_").removeprefix("r_")


def find_side(name: str) -> str:
    """Return left, right or middle, from the beginning of a bone's, cone's or joint's name."""
    lower = name.lower()
    sides = (side for side in ("left", "right") if lower.startswith((f"{side[0]}_", side)))
    return next(sides, "middle")


def plain_name(name: str) -> str:
    """Return a bone's or joint's usual name: left upper arm for `l_upper_arm`."""
    side, words = find_side(name), sideless(name).replace("_", " ")
    return words if side == "middle" else f"{side} {words}"

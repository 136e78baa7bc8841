"""The parts of a body in a report: head, trunk and limbs."""

from __future__ import annotations

from dataclasses import dataclass

from apf.body.limbs import LIMB_ENDS, limb_chains
from apf.body.model import BodyModel


@dataclass(frozen=True)
class Part:
    """A part of a body with its usual name; cones: indices; end: index of its last joint."""

    name: str
    cones: tuple[int, ...]
    end: int


def find_parts(body: BodyModel) -> tuple[Part, ...]:
    """Return trunk, limbs and head of `body`, as far as it has them."""
    numbers = {name: number for number, name in enumerate(body.joint_names)}
    ends = {numbers[joint]: name for name, joint in LIMB_ENDS.items() if joint in numbers}
    heads = [{body.joints[end].bone} for end, name in ends.items() if name == "head"]
    limbs = [set(chain) for chain in limb_chains(body)] + heads
    trunk = set(range(len(body.bones))).difference(*limbs)
    found = [_part(body, trunk, "trunk")]
    for bones in limbs:
        names = [name for end, name in ends.items() if body.joints[end].bone in bones]
        found.append(_part(body, bones, names[0] if names else body.bones[max(bones)].name))
    images = {c for c, cone in enumerate(body.cones) if cone.in_images}
    return tuple(part for part in found if images & set(part.cones) and part.end >= 0)


def _part(body: BodyModel, bones: set[int], name: str) -> Part:
    cones = tuple(c for c, cone in enumerate(body.cones) if cone.bone in bones)
    joints = [j for j, joint in enumerate(body.joints) if joint.bone in bones]
    return Part(name, cones, joints[-1] if joints else -1)

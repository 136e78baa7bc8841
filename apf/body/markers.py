"""Virtual markers: points of a body besides its joints, derived from its cones by name."""

from __future__ import annotations

import numpy as np

from apf.body.model import BodyModel, Cone, Joint, sideless


def virtual_markers(body: BodyModel) -> tuple[Joint, ...]:
    """Return the heels, toes and hands that the cones of `body` define.

    Heel and toe are the ends of the cone `foot`, back and front, including its rounded ends; a hand
    is the distal end of the cone `hand`, or of the forearm if that extends beyond the wrist.
    """
    markers: list[Joint] = []
    for cone in body.cones:
        side, kind = cone.name[: -len(sideless(cone.name))], sideless(cone.name)
        if kind == "foot":
            along = (cone.end - cone.start) / np.linalg.norm(cone.end - cone.start)
            heel, toe = cone.start - cone.radii[0] * along, cone.end + cone.radii[1] * along
            markers += [Joint(f"{side}heel", cone.bone, heel), Joint(f"{side}toe", cone.bone, toe)]
        elif kind == "hand" or (kind == "forearm" and _reaches_beyond_wrist(body, cone, side)):
            markers = [marker for marker in markers if marker.name != f"{side}hand"]
            markers.append(Joint(f"{side}hand", cone.bone, cone.end))
    return tuple(markers)


def _reaches_beyond_wrist(body: BodyModel, cone: Cone, side: str) -> bool:
    """Return whether a forearm's cone extends beyond the wrist by a third of a hand, 6 cm."""
    wrists = [joint for joint in body.joints if joint.name == f"{side}wrist"]
    wrists = [joint for joint in wrists if joint.bone == cone.bone]
    return any(np.linalg.norm(cone.end) > np.linalg.norm(j.position) + 0.06 for j in wrists)

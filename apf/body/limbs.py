"""Which degrees of freedom are the body's trunk and which its limbs."""

from __future__ import annotations

import numpy as np

from apf.body.model import BodyModel


def trunk(body: BodyModel) -> np.ndarray:
    """(D,) bool: the degrees of freedom of bones beyond which the body branches."""
    children = _children(body)
    branches = [False] * len(body.bones)
    for bone in reversed(range(len(body.bones))):  # children come after their parents
        branches[bone] = len(children[bone]) > 1 or any(branches[c] for c in children[bone])
    return _freedoms(body, [bone for bone, branching in enumerate(branches) if branching])


def limbs_of(body: BodyModel) -> np.ndarray:
    """(L, D) bool: the degrees of freedom of each limb of `body`, an unbranched chain of two or
    more bones down to its end, one of several that hang from the same bone."""
    children = _children(body)
    limbs = []
    for first in (child for siblings in children if len(siblings) > 1 for child in siblings):
        chain = [first]
        while len(children[chain[-1]]) == 1:
            chain += children[chain[-1]]
        if len(chain) > 1 and not children[chain[-1]]:
            limbs.append(_freedoms(body, chain))
    return np.array(limbs, bool).reshape(-1, body.n_dof)


def _children(body: BodyModel) -> list[list[int]]:
    """The bones that hang from each bone."""
    children: list[list[int]] = [[] for _ in body.bones]
    for place, bone in enumerate(body.bones):
        if bone.parent >= 0:
            children[bone.parent].append(place)
    return children


def _freedoms(body: BodyModel, bones: list[int]) -> np.ndarray:
    """(D,) bool: the degrees of freedom of these bones."""
    mask = np.zeros(body.n_dof, bool)
    mask[[axis.dof for bone in bones for axis in body.bones[bone].axes]] = True
    return mask

"""Trunk and limbs of a body, read from the structure of its bones: no names are needed."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from apf.body.model import BodyModel


def trunk_bones(body: BodyModel) -> list[int]:
    """Return the bones beyond which the body branches."""
    children = _children(body)
    branches = [False] * len(body.bones)
    for bone in reversed(range(len(body.bones))):  # children come after their parents
        branches[bone] = len(children[bone]) > 1 or any(branches[c] for c in children[bone])
    return [bone for bone, branching in enumerate(branches) if branching]


def trunk_mask(body: BodyModel) -> np.ndarray:
    """Return (D,) bool: the degrees of freedom of the `trunk_bones`."""
    return _dof_mask(body, trunk_bones(body))


def limb_chains(body: BodyModel) -> list[tuple[int, ...]]:
    """Return the bones of each limb, from the trunk to its end.

    A limb is an unbranched chain of two or more bones down to its end, one of several that hang
    from the same bone.
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


def swinging_bones(body: BodyModel) -> list[int]:
    """Return the upper bone of each limb, the last but one of its chain, in the body's order: upper
    arms and thighs, with shoulder blades and hip axes left out."""
    return sorted(chain[-2] for chain in limb_chains(body))


def _children(body: BodyModel) -> list[list[int]]:
    """Return the bones that hang from each bone."""
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

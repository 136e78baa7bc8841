"""The trunk and the limbs of a body."""

from __future__ import annotations

import numpy as np
import pytest

from apf.body import load_body
from apf.body.limbs import limb_chains, limb_masks, swinging_bones, trunk_mask


def test_the_trunk_is_what_branches() -> None:
    body = load_body("song31")
    assert {body.dof_names[d].split(".")[0] for d in np.flatnonzero(trunk_mask(body))} == {
        "pelvis",
        "thorax",
    }


def test_limbs() -> None:
    body = load_body("song31")
    names = [{body.dof_names[d].split(".")[0] for d in np.flatnonzero(m)} for m in limb_masks(body)]
    for side in "lr":
        assert {f"{side}_thigh", f"{side}_calf"} in names
        assert {f"{side}_clavicle", f"{side}_upper_arm", f"{side}_forearm"} in names
    assert len(names) == 4


UPPER = ["l_upper_arm", "r_upper_arm"]
LOWER = ["l_thigh", "r_thigh"]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("song31", UPPER + LOWER),
        ("rymut31", UPPER + LOWER),
        ("rymut31_lower", LOWER),
        ("rymut31_upper", UPPER),
    ],
)
def test_limbs_swing_from_their_upper_bones_whatever_carries_these(
    name: str, expected: list[str]
) -> None:
    body = load_body(name)
    assert [body.bones[bone].name for bone in swinging_bones(body)] == expected
    for chain in limb_chains(body):
        assert [body.bones[child].parent for child in chain[1:]] == list(chain[:-1])

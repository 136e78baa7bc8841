"""The trunk and the limbs of a body."""

from __future__ import annotations

import numpy as np

from apf.body.limbs import limbs_of, trunk
from apf.body.model import load_body


def test_the_trunk_is_what_branches() -> None:
    body = load_body("song31")
    assert {body.dof_names[d].split(".")[0] for d in np.flatnonzero(trunk(body))} == {
        "pelvis",
        "thorax",
    }


def test_limbs() -> None:
    body = load_body("song31")
    names = [{body.dof_names[d].split(".")[0] for d in np.flatnonzero(m)} for m in limbs_of(body)]
    for side in "lr":
        assert {f"{side}_thigh", f"{side}_calf"} in names
        assert {f"{side}_clavicle", f"{side}_upper_arm", f"{side}_forearm"} in names
    assert len(names) == 4

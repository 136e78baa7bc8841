"""The trunk and the limbs of a body."""

import numpy as np
import pytest
from helpers import bodies

from apf.body.kinematics import posed_cones, posed_joints
from apf.body.limbs import (
    add_ankles,
    limb_chains,
    limb_joints,
    limb_masks,
    limb_names,
    solve_inverse_kinematics,
    trunk_mask,
)
from apf.body.stature import stature
from apf.body.toml import format_body, load_body, parse_body


def test_the_trunk_branches_into_limbs() -> None:
    body = load_body("song31")
    masks = [trunk_mask(body), *limb_masks(body)]
    trunk, *names = [{body.dof_names[d].split(".")[0] for d in np.flatnonzero(m)} for m in masks]
    assert trunk == {"pelvis", "thorax"}
    for side in "lr":
        assert {f"{side}_thigh", f"{side}_calf"} in names
        assert {f"{side}_clavicle", f"{side}_upper_arm", f"{side}_forearm"} in names
    assert len(names) == 4


@pytest.mark.parametrize("name", ["song31", "rymut31", "rymut31_lower", "rymut31_upper"])
def test_the_bones_of_a_limb_follow_each_other(name: str) -> None:
    body = load_body(name)
    for chain in limb_chains(body):
        assert [body.bones[child].parent for child in chain[1:]] == list(chain[:-1])


def test_a_limb_reaches_for_places() -> None:
    """Inverse kinematics respects limits, gets as near as possible, and leaves what is in place."""
    body = load_body("song31")
    limbs, joints = limb_masks(body), limb_joints(body)
    poses = np.tile(body.rest_pose, (len(limbs), 1))
    wanted = np.where(limbs, poses + 0.3, poses).clip(body.lower, body.upper)
    places = posed_joints(body, wanted)
    found = solve_inverse_kinematics(body, poses, limbs, joints, places)
    away = np.linalg.norm(posed_joints(body, found) - places, axis=-1)
    assert away[joints].max() < 0.01
    np.testing.assert_array_equal(found[~limbs], poses[~limbs])
    np.testing.assert_array_equal(
        solve_inverse_kinematics(body, wanted, limbs, joints, places), wanted
    )
    far = solve_inverse_kinematics(body, poses, limbs, joints, places + 9.0)
    assert np.all((far >= body.lower) & (far <= body.upper)) and np.isfinite(far).all()


@pytest.mark.parametrize("name", ["song31", "song32", "rymut31", "rymut31_lower"])
def test_feet_turn_about_ankles(name: str) -> None:
    """Nothing else changes, neither in files nor if ankles are added once more."""
    body = bodies.named(name)
    footed = parse_body(format_body(add_ankles(body)), "footed")
    assert add_ankles(footed) is not None and add_ankles(footed).n_dof == footed.n_dof
    poses = bodies.random_poses(body, 2)
    padded = np.pad(poses, ((0, 0), (0, footed.n_dof - body.n_dof)))
    np.testing.assert_allclose(posed_joints(footed, padded), posed_joints(body, poses), atol=1e-9)
    np.testing.assert_allclose(posed_cones(footed, padded), posed_cones(body, poses), atol=1e-9)
    assert limb_names(footed) == limb_names(body)
    assert stature(footed) == pytest.approx(stature(body))
    turned = padded.copy()
    turned[:, footed.dof_names.index("l_foot.ry")] += 0.3
    moved = np.abs(posed_cones(footed, turned) - posed_cones(footed, padded)).max((0, 2)) > 1e-3
    assert {footed.cone_names[k] for k in np.flatnonzero(moved)} == {"l_foot"}

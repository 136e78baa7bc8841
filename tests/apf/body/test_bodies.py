"""The thesis's body and its halves, and bodies that begin from another one."""

from pathlib import Path

import numpy as np
import pytest
from helpers import outlines, scenes
from helpers.commands import fail, succeed

from apf.backend import make_feature_extractor, make_tracker
from apf.body.kinematics import posed_cones, posed_joints
from apf.body.stature import lowest_point, stature
from apf.body.toml import format_body, load_body, parse_body
from apf.filters.method import Method
from apf.image_objective.config import FeatureConfig
from apf.scene import Scene
from apf.synthetic.courses import roam
from apf.synthetic.walk import Walk
from cl import Device, InputError


@pytest.mark.parametrize("name", ["rymut31_upper", "rymut31_lower"])
def test_halves_pose_as_the_whole_body_does(name: str) -> None:
    whole, body = load_body("rymut31"), load_body(name)
    pose = whole.rest_pose + np.random.default_rng(0).normal(0, 0.2, 31)
    common = pose[[whole.dof_names.index(name) for name in body.dof_names]]
    ours = posed_joints(body, common[None])[0]
    theirs = posed_joints(whole, pose[None])[0]
    places = [whole.joint_names.index(joint) for joint in body.joint_names]
    np.testing.assert_allclose(ours, theirs[places], atol=1e-9)


def test_a_moving_body_is_tracked_by_its_silhouettes_and_edges(device: Device) -> None:
    body, rig = load_body("song31"), scenes.ring(3, size=(160, 120))
    method = Method.create("pso", "sp", n_particles=200, n_layers=12)
    tracker = make_tracker(Scene(device, rig, None, body), method)
    tracker.start(body.rest_pose)
    features = make_feature_extractor(device, rig, None, FeatureConfig(edges="outline"))
    random = np.random.default_rng(1)
    direction = random.choice([-1, 1], body.n_dof) * body.sigma
    for step in range(1, 7):
        pose = np.clip(body.rest_pose + step * direction, body.lower, body.upper)
        masks = np.uint8(255) * outlines.masks(rig, posed_cones(body, pose[None])[0])
        features(scenes.frame(masks=masks))
        estimate = tracker.step(features).pose
    start, end, reached = posed_joints(body, np.stack([body.rest_pose, pose, estimate]))
    moved, missed = (np.linalg.norm(end - there, axis=-1) for there in (start, reached))
    assert missed.mean() < 0.5 * moved.mean()
    assert missed.mean() < 0.05


@pytest.mark.parametrize("name", ["blade", "child", "dog", "one_arm", "wheelchair"])
def test_other_bodies_are_bodies_and_roam_within_their_limits_on_the_floor(name: str) -> None:
    body = load_body(name)
    assert parse_body(format_body(body), name).dof_names == body.dof_names
    assert np.all((body.lower <= body.rest_pose) & (body.rest_pose <= body.upper))
    said = "".join(succeed("apf", "body", action, name).out for action in ("show", "check"))
    assert f"{name}: {len(body.bones)} bones" in said and "no automatic start" not in said
    poses = roam(body, Walk(), np.arange(40) / 30, 1)
    assert np.all((poses >= body.lower - 1e-9) & (poses <= body.upper + 1e-9))
    lowest = [lowest_point(cones) for cones in posed_cones(body, poses)]
    np.testing.assert_allclose(lowest, 0, atol=1e-9)
    assert np.all(np.ptp(poses[:, body.sigma > 0.009], axis=0) > 0.05)


def test_what_a_file_says_replaces_the_base_which_may_be_a_file_beside_it(tmp_path: Path) -> None:
    song, child, one_arm = (load_body(name) for name in ("song32", "child", "one_arm"))
    assert stature(child) == pytest.approx(1.1, abs=0.01)
    assert "l_forearm" not in [*one_arm.cone_names, *(bone.name for bone in one_arm.bones)]
    assert set(song.joint_names) - set(one_arm.joint_names) == {"l_wrist"}
    assert len(one_arm.edges) == len(song.edges) - 1
    (tmp_path / "first.toml").write_text('base = "song32"\nname = "first"\nscale = 0.5')
    (tmp_path / "second.toml").write_text('base = "first.toml"\nname = "second"\nscale = 2.0')
    again = load_body(tmp_path / "second.toml")
    np.testing.assert_allclose(again.rest_pose, song.rest_pose)
    np.testing.assert_allclose(again.cones[3].end, song.cones[3].end)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('base = "nobody"\nname = "a"', "nobody: no body model; expected"),
        ('base = "song32"\nname = "a"\nwithout = ["wing"]', "no bone named 'wing'"),
        ('base = "song32"\nname = "a"\nlengths = { wing = 2.0 }', "lengths: no 'wing'"),
        ('base = "song32"\nname = "a"\nscale = 5.0', "measures"),
        ('base = "song32"\nname = "a"\nwings = 2', "wings"),
    ],
)
def test_wrong_files_are_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        load_body(path)
    assert fail("apf", "body", "check", path).count("\n") == 1

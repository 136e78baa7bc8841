"""Keypoint names are points on the body, independent of its limbs' directions at angle 0."""

from pathlib import Path

import numpy as np
import pytest
from helpers.keypoints import world_points
from helpers.shared import shared_data

import apf
from apf.body.bodytrack import read_body
from apf.body.kinematics import posed_joints
from apf.body.toml import load_body
from apf.keypoints.landmarks import find_landmarks, load_landmarks, locate_points
from apf.keypoints.readers import orders

ORDERS = ("MEDIAPIPE", "COCO_17", "COCO_18", "BODY_25", "BODY_25B", "HALPE_26")


@pytest.mark.parametrize("name", ORDERS)
def test_every_name_of_the_known_networks_is_a_landmark(name: str) -> None:
    names = getattr(orders, name)
    found = find_landmarks(names)
    assert sorted(found) == list(range(len(names)))
    for index, landmark in found.items():
        said = next((s for s in "lr" if landmarks_side(names[index]) == s), None)
        assert (said is None) == (landmark.partner is None)
        if said is not None:
            assert landmark.name.startswith(f"{said}_"), names[index]


def landmarks_side(name: str) -> str | None:
    """Return left or right of a network's name, as a reader would understand it."""
    words = name.lower().split("_")
    if "left" in words or "right" in words:
        return "l" if "left" in words else "r"
    return name[0].lower() if name[0] in "LR" and name[1].isupper() else None


def test_points_lie_where_the_body_has_them() -> None:
    body = load_body("song31")
    names = orders.MEDIAPIPE
    on = locate_points(body, names)
    assert len(on) == 33 and list(on.columns) == list(range(33))
    places = dict(zip(names, world_points(body, body.rest_pose[None], names)[0], strict=True))
    joints = dict(zip(body.joint_names, posed_joints(body, body.rest_pose[None])[0], strict=True))
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"):
        for side in ("left", "right"):
            away = places[f"{side}_{joint}"] - joints[f"{side[0]}_{joint}"]
            assert np.linalg.norm(away) < 0.05
    assert places["nose"][0] > joints["head_top"][0] + 0.05
    assert places["left_foot_index"][0] > joints["l_ankle"][0] + 0.1 > places["left_heel"][0]
    for name, partner in zip(on.names, on.partners, strict=True):
        mirrored = world_points(body, np.zeros((1, body.n_dof)), names)[0]
        own, other = mirrored[on.names.index(name)], mirrored[partner]
        np.testing.assert_allclose(own * [1, -1, 1], other, atol=1e-9)


def test_a_body_whose_arms_point_backwards_at_zero_has_its_hands_beyond_the_wrists() -> None:
    body = read_body(shared_data("bodytrack_walk"))
    poses = np.random.default_rng(1).normal(body.rest_pose, 0.2, (4, body.n_dof))
    joints = {n: posed_joints(body, poses)[:, j] for j, n in enumerate(body.joint_names)}
    points = world_points(body, poses, orders.MEDIAPIPE).swapaxes(0, 1)
    places = dict(zip(orders.MEDIAPIPE, points, strict=True))
    for side in ("left", "right"):
        elbow, wrist = joints[f"{side[0]}_elbow"], joints[f"{side[0]}_wrist"]
        along = (wrist - elbow) / np.linalg.norm(wrist - elbow, axis=-1, keepdims=True)
        beyond = ((places[f"{side}_index"] - wrist) * along).sum(-1)
        assert beyond.min() > 0.05


def test_names_that_are_none_and_bad_tables_are_errors(tmp_path: Path) -> None:
    with pytest.raises(apf.InputError, match=r"none of the keypoints tail, fin .*left_shoulder"):
        locate_points(load_body("song31"), ["tail", "fin"])
    table, whole = tmp_path / "landmarks.toml", '[[landmark]]\nname = "a"\njoint = "n"\n'
    twice = '[[landmark]]\nname = "{}"\naliases = ["x"]\njoint = "n"\nspread = 0.1\n'
    for text, message in (
        ("", r"holds no \[\[landmark\]\]"),
        ('[[landmark]]\nname = "nose"\n', "lacks the key landmark nose, joint"),
        (f"{whole}spread = 3.0\n", "spread is 3.0; expected less than 1"),
        (f"{whole}spread = 0.1\ncolour = 1\n", "colour, which is unknown"),
        (f"{whole}spread = 0.1\noffset = [1]\n", "expected at least 3"),
        (twice.format("a") + twice.format("b"), "x is a name of both a and b"),
    ):
        table.write_text(text)
        load_landmarks.cache_clear()
        with pytest.raises(apf.InputError, match=message):
            load_landmarks(table)

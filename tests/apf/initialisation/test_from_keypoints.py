"""Bodies, poses and points on the body that are estimated from keypoints."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.keypoints import of_poses

from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.body.stature import stature
from apf.body.toml import load_body
from apf.initialisation.from_keypoints import (
    KeypointStart,
    fit_pose_to_points,
    start_from_keypoints,
)
from apf.initialisation.start import StartError
from apf.keypoints.landmarks import locate_points
from apf.keypoints.readers.orders import MEDIAPIPE
from apf.likelihood.observations import make_empty_observations
from cl import InputError

TEMPLATE = load_body("song31")
RIG = scenes.ring(4, size=(640, 480), radius=4.0)


def child() -> BodyModel:
    """0.7 of the template, with long legs."""
    lengths = dict.fromkeys(TEMPLATE.scale_groups, 0.7) | {"thigh": 0.78, "calf": 0.76}
    return TEMPLATE.scaled(lengths, 0.7)


def poses_of(body: BodyModel, n: int = 8) -> np.ndarray:
    """(n, D) a person who turns round while limbs swing."""
    time = np.arange(n)[:, None] / n
    poses = bodies.random_poses(body, 1)[0] + 0.3 * np.sin(6 * time + np.arange(body.n_dof))
    poses[:, :3] = body.rest_pose[:3] * 0.7 + 0.1 * time
    poses[:, body.dof_names.index("pelvis.rz")] = 4 * time[:, 0]
    return np.clip(poses, body.lower, body.upper)


def mean_error(start: KeypointStart) -> float:
    """Return the mean error, m, over joints and frames, of a start by keypoints of the child."""
    truth = posed_joints(child(), poses_of(child())[start.frames])
    return float(np.linalg.norm(posed_joints(start.body, start.poses) - truth, axis=-1).mean())


@pytest.fixture(scope="module")
def clean_start() -> KeypointStart:
    """The start by keypoints of the child without damage."""
    keypoints = of_poses(RIG, child(), poses_of(child()), noise=2.0)
    return start_from_keypoints(RIG, keypoints, TEMPLATE, range(keypoints.n_frames))


def test_lengths_and_poses_of_a_child_who_turns(clean_start: KeypointStart) -> None:
    assert stature(clean_start.body) == pytest.approx(stature(child()), rel=0.08)
    assert mean_error(clean_start) < 0.03
    assert 0.5 < np.median(clean_start.model.error) < 4
    assert clean_start.anchored[0] == 0
    seen = clean_start.observations(2)
    assert len(seen) == seen.most == seen.usual == 4 * 33
    points, own = clean_start.keypoints.points[:, 2], locate_points(TEMPLATE, MEDIAPIPE)
    few = clean_start.model.observations(points * np.array([1, *[np.nan] * 3])[:, None, None])
    assert few.few and not seen.few and not make_empty_observations().few
    assert (seen.partner[seen.point == 0] == -1).all() and (seen.bone == own.bones).all()
    knee = own.names.index("l_knee")
    np.testing.assert_allclose(seen.pixel[seen.point == knee], points[:, own.columns[knee], :2])


def test_known_height_and_shape_are_kept() -> None:
    body = child()
    poses = poses_of(body, 3)
    keypoints = of_poses(RIG, body, poses, noise=2.0)
    tall = start_from_keypoints(RIG, keypoints, TEMPLATE, range(3), height=1.4)
    assert stature(tall.body) == pytest.approx(1.4, abs=0.01)
    kept = start_from_keypoints(RIG, keypoints, body, range(3), keep_shape=True)
    np.testing.assert_allclose(
        [bone.offset for bone in kept.body.bones], [bone.offset for bone in body.bones]
    )


@pytest.mark.parametrize("damage", ["outliers", "exchange"])
def test_what_networks_do_costs_little(clean_start: KeypointStart, damage: str) -> None:
    """A fifth of the keypoints anywhere, or left and right exchanged in a camera."""
    keypoints = of_poses(RIG, child(), poses_of(child()), noise=2.0)
    points, random = keypoints.points.copy(), np.random.default_rng(0)
    if damage == "outliers":
        wrong = random.random(points.shape[:3]) < 0.2
        points[wrong, :2] = random.uniform(0, 480, (wrong.sum(), 2))
    else:
        points[1] = points[1][:, locate_points(TEMPLATE, keypoints.names).partners]
    damaged = replace(keypoints, points=points)
    start = start_from_keypoints(RIG, damaged, TEMPLATE, range(keypoints.n_frames))
    assert mean_error(start) < 1.25 * mean_error(clean_start) + 0.002


def test_frames_and_keypoints_that_show_nobody() -> None:
    body = child()
    poses = poses_of(body, 4)
    keypoints = of_poses(RIG, body, poses)
    keypoints.points[:, :2] = np.nan
    assert start_from_keypoints(RIG, keypoints, TEMPLATE, range(4)).frames.tolist() == [2, 3]
    with pytest.raises(InputError, match="cameras are"):
        start_from_keypoints(scenes.ring(3), keypoints, TEMPLATE, range(4))
    keypoints.points[:] = np.nan
    with pytest.raises(StartError, match="no frame has 6 keypoints"):
        start_from_keypoints(RIG, keypoints, TEMPLATE, range(4))


def test_the_pose_of_one_frame() -> None:
    """Of a person who stands anywhere and looks anywhere."""
    poses = poses_of(TEMPLATE, 2)
    start = start_from_keypoints(RIG, of_poses(RIG, TEMPLATE, poses), TEMPLATE, range(2))
    for frame, pose in enumerate(poses):
        alone = fit_pose_to_points(start.body, RIG, start.observations(frame))
        assert alone is not None
        away = posed_joints(start.body, alone[None]) - posed_joints(TEMPLATE, pose[None])
        assert np.linalg.norm(away, axis=-1).mean() < 0.02
    assert fit_pose_to_points(TEMPLATE, RIG, make_empty_observations()) is None

"""Covariance of joints from that of the pose."""

import numpy as np
from helpers import bodies

from apf.body.angles import joint_angles
from apf.body.kinematics import posed_joints
from apf.body.toml import load_body
from apf.tracking.uncertainty import (
    FLOORS,
    SCALE,
    SOUND_MISFIT,
    angle_bands,
    is_inside_ellipsoid,
    joint_covariance,
    raw_covariance,
)

SONG = load_body("song31")


def information(random: np.random.Generator, n: int) -> np.ndarray:
    """(D, D) of a pose known to about a hundredth."""
    root = random.normal(size=(n, n))
    return 1e4 * (np.eye(n) + 0.3 * root @ root.T / n)


def test_joints_spread_as_samples_of_the_pose_do() -> None:
    random = np.random.default_rng(2)
    pose = bodies.random_poses(SONG, 1)[0]
    known = information(random, SONG.n_dof)
    deviation = np.full(SONG.n_dof, 0.005)
    covariance = np.linalg.inv(known) + np.diag(deviation**2)
    samples = random.multivariate_normal(pose, covariance, 20_000)
    joints = posed_joints(SONG, samples)
    centred = joints - joints.mean(0)
    expected = np.einsum("nja,njb->jab", centred, centred) / len(samples)
    found = raw_covariance(SONG, pose[None], known[None], deviation[None])[0]
    np.testing.assert_allclose(found, expected, atol=0.06 * expected.max())
    truth = posed_joints(SONG, pose[None])[0]
    held = is_inside_ellipsoid(
        joints - truth, np.broadcast_to(found + 1e-9 * np.eye(3), (20_000, *found.shape))
    )
    np.testing.assert_allclose(held.mean(), 0.95, atol=0.01)


def test_angles_are_as_far_off_as_those_of_poses_fitted_to_uncertain_joints() -> None:
    random = np.random.default_rng(3)
    pose = bodies.random_poses(SONG, 1)[0]
    joints, error = posed_joints(SONG, pose[None])[0], 0.002
    covariance = np.full((2, len(joints), 3, 3), np.nan)
    covariance[0] = error**2 * np.eye(3)
    found = angle_bands(SONG, np.stack([pose, pose]), covariance)
    seen = joints + random.normal(scale=error, size=(400, *joints.shape))
    step, axes = 1e-6, np.eye(SONG.n_dof)
    slopes = (posed_joints(SONG, pose + step * axes) - joints).reshape(len(axes), -1) / step / error
    solved = np.linalg.pinv(np.vstack([slopes.T, axes]))
    fitted = np.tile(pose, (len(seen), 1))
    for _ in range(4):  # Gauss and Newton's, with the first slopes
        off = (posed_joints(SONG, fitted) - seen).reshape(len(seen), -1) / error
        fitted = fitted - np.hstack([off, fitted - pose]) @ solved.T
    angles = joint_angles(SONG, fitted)
    for name in ("l_knee_flexion", "r_knee_flexion"):
        np.testing.assert_allclose(found[name][0], 1.96 * angles[name].std(), rtol=0.15)
        assert np.isnan(found[name][1])


def test_calibration_scales_and_adds_a_floor_per_joint() -> None:
    """Deviations grow with the misfit. Frames that nothing refined have none, as all of those of
    the papers' presets, whose particles' spread nobody calibrated."""
    poses, deviation = bodies.random_poses(SONG, 5), np.full((5, 31), 0.01)
    known = np.array([1, 1, 1, 1, 0])[:, None, None] * 1e4 * np.eye(31)
    raw = raw_covariance(SONG, poses, known, deviation)
    sound = joint_covariance(SONG, poses, known, deviation)
    for name in ("l_wrist", "r_wrist", "pelvis"):
        place, floor = SONG.joint_names.index(name), FLOORS[name.removeprefix(name[0] + "_")]
        expected = SCALE**2 * raw[:4, place] + floor**2 * np.eye(3)
        np.testing.assert_allclose(sound[:4, place], expected)
    assert np.isnan(sound[4]).all()
    misfit = SOUND_MISFIT * np.array([0.5, 1.0, 3.0, np.nan, 1.0])
    found = joint_covariance(SONG, poses, known, deviation, misfit=misfit)
    factors = np.array([1.0, 1.0, 3.0, 1.0, 1.0])
    np.testing.assert_allclose(found, factors[:, None, None, None] ** 2 * sound)

"""Smoothing tracks in time, and `apf smooth`."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import tracks
from helpers.commands import succeed

from apf.body.kinematics import posed_joints
from apf.body.toml import load_body
from apf.tracking.smoothing import SmoothingConfig, find_unbroken_parts, smooth_series, smooth_track
from apf.tracking.track import Track

BODY = load_body("song31")
CUTOFF = SmoothingConfig(cutoff=6.0)


def jittery(frames: int = 120, **change: object) -> tuple[Track, Track]:
    """A walk, and the same with noise on every angle and place."""
    true = tracks.walker(frames)
    noise = np.random.default_rng(3).normal(size=true.poses.shape) * 0.02
    return true, replace(true, poses=np.clip(true.poses + noise, BODY.lower, BODY.upper), **change)


def distance(a: Track, b: Track) -> float:
    return float(np.linalg.norm(a.joints - b.joints, axis=-1).mean())


def test_jitter_goes_motion_stays_and_uncertain_frames_count_less() -> None:
    true, noisy = jittery()
    noisy = replace(noisy, joints=posed_joints(BODY, noisy.poses))
    whole = smooth_track(noisy, CUTOFF)
    lagging = smooth_track(noisy, SmoothingConfig(cutoff=6.0, lag=6))
    blind = smooth_track(noisy, SmoothingConfig(cutoff=6.0, lag=0))
    before = distance(noisy, true)
    assert before > 0.02
    assert distance(whole, true) < 0.55 * before
    assert distance(whole, true) <= distance(lagging, true) < distance(blind, true) < before
    track = noisy
    deviation = np.ones_like(track.poses)
    outliers = track.poses.copy()
    outliers[60, 0] += 0.5
    deviation[60, 0] = 20
    track = replace(track, poses=outliers, diagnostics={"deviation": deviation})
    trusted = replace(track, diagnostics={})
    errors = [abs(smooth_track(t).poses[60, 0] - true.poses[60, 0]) for t in (track, trusted)]
    assert errors[0] < 0.03 < 0.1 < errors[1]


@pytest.mark.parametrize("cutoff", [2.0, 5.0])
@pytest.mark.parametrize(("share", "amplitude"), [(1, 0.5), (1 / 4, 1)])
def test_the_cutoff_halves_the_amplitude(cutoff: float, share: float, amplitude: float) -> None:
    times = np.arange(2000) / 100
    wave = np.sin(2 * np.pi * share * cutoff * times)[:, None]
    found = smooth_series(wave, np.ones_like(wave), times, SmoothingConfig(cutoff=cutoff))
    np.testing.assert_allclose(found[500:1500], amplitude * wave[500:1500], atol=0.01)


def test_turning_round_and_round() -> None:
    track = tracks.walker(200)
    heading = BODY.dof_names.index("pelvis.rz")
    poses = track.poses.copy()
    poses[:, heading] = np.linspace(0, 4 * np.pi, 200)
    wrapped = poses.copy()
    wrapped[:, heading] = (poses[:, heading] + np.pi) % (2 * np.pi) - np.pi
    found = smooth_track(replace(track, poses=wrapped))
    np.testing.assert_allclose(found.poses[:, heading], poses[:, heading], atol=0.03)


def test_other_angles_of_the_same_rotation_move_no_limb() -> None:
    track = tracks.walker(60)
    dofs = [BODY.dof_names.index(f"r_upper_arm.r{axis}") for axis in "xyz"]
    poses = track.poses.copy()
    poses[:, dofs] = 2.6, 0.75, 1.4
    steady = replace(track, poses=poses, joints=posed_joints(BODY, poses))
    poses = poses.copy()
    poses[30:, dofs] = 2.6 - np.pi, np.pi - 0.75, 1.4 - np.pi
    turned = replace(track, poses=poses, joints=posed_joints(BODY, poses))
    np.testing.assert_allclose(turned.joints, steady.joints, atol=1e-9)
    np.testing.assert_allclose(smooth_track(turned).joints, smooth_track(steady).joints, atol=1e-6)


def test_lost_frames_stay_as_they_are() -> None:
    track = tracks.lose(jittery()[1], [0, *range(50, 60)])
    lost = track.lost
    assert find_unbroken_parts(track) == [slice(1, 50), slice(60, 120)]
    found = smooth_track(track)
    np.testing.assert_array_equal(found.lost, lost)
    np.testing.assert_array_equal(found.poses[lost], track.poses[lost])
    assert np.abs(found.poses[~lost] - track.poses[~lost]).max() > 0.01
    # What lies on one side of the gap does not reach the other.
    moved = track.poses.copy()
    moved[:50] += 1.0
    again = smooth_track(replace(track, poses=np.clip(moved, BODY.lower, BODY.upper)))
    np.testing.assert_array_equal(again.poses[60:], found.poses[60:])
    for short in map(tracks.walker, (0, 1, 2)):
        np.testing.assert_allclose(smooth_track(short).joints, short.joints, atol=1e-12)


def test_the_command(tmp_path: Path) -> None:
    _, track = jittery()
    track.save(tmp_path / "a" / "track.npz")
    succeed("apf", "smooth", tmp_path / "a", "-o", tmp_path / "b", "--lag", "4")
    names = {path.name for path in (tmp_path / "b").iterdir()}
    assert names >= {"track.npz", "joints.trc", "joints.csv", "body.toml", "settings.toml"}
    found, expected = Track.open(tmp_path / "b"), smooth_track(track, SmoothingConfig(lag=4))
    assert found.smoothing == expected.smoothing and found.smoothing["lag_frames"] == 4
    assert Track.open(tmp_path / "a").smoothing is None
    np.testing.assert_allclose(found.poses, expected.poses, atol=1e-9)

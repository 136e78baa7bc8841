"""Feet that stand: found, and held."""

import numpy as np
import pytest
from helpers.striders import SONG, Stride, strider, track_of_poses

from apf.body.kinematics import posed_cones
from apf.body.limbs import add_ankles
from apf.body.stature import lowest_point
from apf.body.toml import load_body
from apf.tracking.foot_contact import detect_flat_feet, detect_standing, find_ankles, raise_soles
from apf.tracking.smoothing import SmoothingConfig, smooth_track
from apf.tracking.track import Track
from psfs.common.numbers import find_true_runs

ANKLES = find_ankles(SONG)
JOINTS = ("knee", "ankle")


def travel(track: Track, stands: np.ndarray) -> float:
    """The farthest, m, that any foot gets along the floor while it stands, but for the frames in
    which it lands or leaves."""
    found = [0.0]
    for foot, ankle in enumerate(ANKLES):
        for stance in find_true_runs(stands[:, foot]):
            places = track.joints[stance.start + 3 : stance.stop - 3, ankle, :2]
            if len(places):
                found.append(np.linalg.norm(places[:, None] - places[None], axis=-1).max())
    return float(max(found))


@pytest.mark.parametrize("fps", [30.0, 120.0])
def test_stances_are_found(fps: float) -> None:
    stride = Stride(fps=fps)
    track = strider(int(2.5 * fps), stride)
    found, true = detect_standing(track.joints[:, ANKLES], track.times), stride.stands(len(track))
    assert (found == true).mean() > 0.9
    assert len(find_true_runs(found[:, 0])) == len(find_true_runs(true[:, 0]))
    late = [f.start - t.start for f, t in zip(*(find_true_runs(s[:, 1]) for s in (found, true)))]  # noqa: B905
    assert np.abs(late).max() <= 0.07 * fps


def test_standing_feet_do_not_slide_and_the_rest_stays() -> None:
    noisy, true = strider(noise=0.03), strider()
    stands = Stride().stands(len(true))
    free = smooth_track(noisy, SmoothingConfig(hold_feet=False))
    held = smooth_track(noisy)
    assert travel(noisy, stands) > 0.05 and travel(free, stands) > 0.02
    assert travel(held, stands) < 0.01
    errors = [np.linalg.norm(t.joints - true.joints, axis=-1).mean() for t in (noisy, free, held)]
    assert errors[2] <= 1.02 * errors[1] < errors[0]
    # Nothing jumps where a foot begins to be held.
    jerk = [np.linalg.norm(np.diff(t.joints[:, ANKLES], 2, axis=0), axis=-1) for t in (free, held)]
    assert jerk[1].max() < jerk[0].max() + 0.005 and jerk[1].mean() < 1.05 * jerk[0].mean()
    assert np.all(held.poses >= SONG.lower) and np.all(held.poses <= SONG.upper)
    assert held.standing.any() and not free.standing.any()
    assert held.smoothing is not None and held.smoothing["feet"] == "held"


def test_what_does_not_stand() -> None:
    """A foot that is drawn along slowly, or is in the air, or unknown; a risen heel is not flat."""
    times = np.arange(120) / 60
    feet = np.zeros((120, 2, 3))
    feet[:, 0, 0] = 0.2 * times  # 0.4 m in 2 s, slower than any limit
    feet[:, 1, 0] = 0.02 * times  # what a tracker may drift
    assert detect_standing(feet, times).all(0).tolist() == [False, True]
    assert not detect_standing(feet, times)[:, 0].any()
    feet[:, :, 0], feet[:, 0, 2], feet[:, 1, 2] = 0, 0.08, 0.3
    assert not detect_standing(feet, times)[:, 1].any()
    feet[20:30] = np.nan
    found = detect_standing(feet, times)
    assert find_true_runs(found[:, 0]) == [slice(0, 20), slice(30, 120)]
    assert not detect_standing(np.full((5, 2, 3), np.nan), np.arange(5.0)).any()
    assert detect_standing(np.zeros((1, 2, 3)), np.zeros(1)).shape == (1, 2)
    ankles, stands = np.zeros((30, 2, 3)), np.ones((30, 2), bool)
    ankles[20:, 0, 2] = np.linspace(0, 0.1, 10)
    found = detect_flat_feet(ankles, stands)
    assert found[:22].all() and not found[23:, 0].any() and found[:, 1].all()
    upper = load_body("rymut31_upper")
    held = smooth_track(track_of_poses(upper, np.tile(upper.rest_pose, (20, 1))))
    assert not find_ankles(upper) and held.standing.shape == (20, 2) and not held.standing.any()


def test_ankles_are_known_where_a_foot_stands_flat() -> None:
    """Then the foot is level, and the angle is by how much the shank leans forward."""
    true = strider()
    assert "l_ankle_dorsiflexion" not in true.angles
    held = smooth_track(strider(noise=0.01))
    for foot, side in enumerate("lr"):
        knee, ankle = (true.joints[:, SONG.joint_names.index(f"{side}_{j}")] for j in JOINTS)
        lean = np.degrees(np.arctan2(knee[:, 0] - ankle[:, 0], knee[:, 2] - ankle[:, 2]))
        found = held.angles[f"{side}_ankle_dorsiflexion"]
        known = np.isfinite(found)
        assert (
            known[held.standing[:, foot]].mean() > 0.9 and not known[~held.standing[:, foot]].any()
        )
        assert np.abs(found - lean)[known].mean() < 2
        assert np.ptp(lean[known]) > 20


def test_soles_that_can_turn_stay_above_the_floor() -> None:
    body = add_ankles(SONG)
    poses = np.tile(body.rest_pose, (40, 1))
    cones = posed_cones(body, poses)[0]
    poses[:, 2] -= lowest_point(cones)  # it stands
    pitch = [body.dof_names.index(f"{side}_foot.ry") for side in "lr"]
    poses[:, pitch[0]] = np.linspace(-0.1, 0.4, 40)  # toes down, through the floor
    raised = raise_soles(body, poses)
    others = np.delete(np.arange(body.n_dof), pitch)
    np.testing.assert_array_equal(raised[:, others], poses[:, others])
    assert min(lowest_point(of) for of in posed_cones(body, poses)) < -0.04
    assert min(lowest_point(of) for of in posed_cones(body, raised)) > -0.003
    np.testing.assert_array_equal(raise_soles(SONG, poses[:, : SONG.n_dof]), poses[:, : SONG.n_dof])
    poses[:, 2] -= 1  # a floor elsewhere says nothing
    np.testing.assert_array_equal(raise_soles(body, poses), poses)

"""Limbs that a track does not believe: flagged, missing or bridged in its files."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import ezc3d
import numpy as np
import pygltflib
import pytest
from helpers import tracks
from helpers.commands import succeed

from apf.body.limbs import limb_names
from apf.evaluation.evaluate import evaluate
from apf.report.quality import Quality
from apf.tracking.smoothing import smooth_track
from apf.tracking.track import Track

LOST = slice(10, 14)


@pytest.fixture(scope="module")
def track() -> Track:
    """A walker whose left arm is lost in some frames."""
    walker = tracks.walker()
    names = limb_names(walker.its_body)
    believed = np.full((len(walker), len(names)), 0.9)
    believed[LOST, names.index("left arm")] = 0.1
    poses = walker.poses.copy()
    poses[LOST, walker.dof_names.index("l_forearm.ry")] += 2.0
    return replace(
        walker, poses=poses, diagnostics={**walker.diagnostics, "limb_confidence": believed}
    )


def test_points_and_angles_are_missing_where_the_limb_is_lost_and_poses_bridge_it(
    track: Track,
) -> None:
    points, angles = track.points, track.angles
    missing = dict(zip(points.joint_names, np.isnan(points.joints).any(2).T, strict=True))
    for name in ("l_elbow", "l_wrist", "l_hand"):
        assert np.flatnonzero(missing[name]).tolist() == [10, 11, 12, 13]
    assert not any(missing[name].any() for name in ("r_wrist", "l_hip", "l_ankle", "head_top"))
    assert np.isnan(angles["l_elbow_flexion"][LOST]).all()
    assert all(np.isfinite(angles[name]).all() for name in ("r_elbow_flexion", "l_knee_flexion"))
    assert np.isfinite(track.joints).all()  # the raw ones stay
    # Where a whole body is needed, its poses go on from one side to the other.
    elbow, hip = (track.dof_names.index(name) for name in ("l_forearm.ry", "l_thigh.ry"))
    poses = track.motion.poses
    ends = track.poses[[9, 14], elbow]
    np.testing.assert_allclose(poses[9:15, elbow], np.linspace(*ends, 6))
    np.testing.assert_array_equal(poses[:, hip], track.poses[:, hip])


def test_every_file_says_it(track: Track, tmp_path: Path) -> None:
    """Missing points and angles are empty in them, and bridged poses flagged."""
    for ending in ("npz", "c3d", "mot", "glb"):
        track.save(tmp_path / f"x.{ending}")
    np.testing.assert_array_equal(Track.open(tmp_path / "x.npz").lost_limbs, track.lost_limbs)
    wrist = track.points.joint_names.index("l_wrist")
    c3d = ezc3d.c3d(str(tmp_path / "x.c3d"))
    assert (c3d["data"]["meta_points"]["residuals"][0, wrist, LOST] == -1).all()
    with (tmp_path / "x_filled.csv").open() as file:
        filled = list(csv.DictReader(file))
    assert [k for k, flags in enumerate(filled) if flags["elbow_flex_l"] == "1"] == [10, 11, 12, 13]
    assert not any(flags["elbow_flex_r"] == "1" for flags in filled)
    extras = pygltflib.GLTF2().load(str(tmp_path / "x.glb")).animations[0].extras
    assert extras["lost_limbs"] == {"left arm": [10, 11, 12, 13]}


def test_commands_keep_and_say_it(track: Track, tmp_path: Path) -> None:
    track.save(tmp_path / "track.npz")
    said = succeed("apf", "export", tmp_path, "-o", tmp_path / "out", "--to", "trc", "bvh").out
    assert "left arm in 10-13" in " ".join(said.split())
    np.testing.assert_array_equal(smooth_track(track).lost_limbs, track.lost_limbs)
    found = evaluate(track, tracks.truth_of(track))
    assert found.predicted_lost_fraction == {"left arm": pytest.approx(4 / 30)}
    assert json.loads(json.dumps(found.summary()))["limbs_said_to_be_lost"] == {"left arm": 0.13333}


def test_a_report_looks_at_it(track: Track) -> None:
    """Where the person is lost no limb is lost besides."""
    quality = Quality(tracks.lose(track, 12), None)
    assert quality.doubtful["left arm"].tolist() == [10, 11, 13]
    facts, others = quality.facts(), dict.fromkeys(limb_names(track.its_body), "")
    assert facts["lost_limbs"] == others | {"left arm": "10-11, 13"}
    assert facts["parts"]["right arm"]["mean_confidence"] == pytest.approx(0.9 * 29 / 30, abs=1e-3)


def test_flags_beside_the_truth(track: Track) -> None:
    """The arm is 300 mm off in five frames, in three of which it is flagged; the legs are right."""
    joints = track.joints.copy()
    joints[11:16, track.joint_names.index("l_wrist"), 2] += 0.3
    covariance = np.tile(0.02**2 * np.eye(3), (len(track), joints.shape[1], 1, 1))
    diagnostics = {**track.diagnostics, "covariance": covariance}
    found = evaluate(replace(track, joints=joints, diagnostics=diagnostics), tracks.truth_of(track))
    assert found.flags == (3, 5, 1, 4 * 30 - 5)
    assert found.flags.found == 0.6 and found.flags.falsely == pytest.approx(1 / 115)
    unflagged = 30 * 15 - 4 * 3  # shoulder, elbow and wrist
    assert found.inside_unflagged == pytest.approx(1 - 2 / unflagged)

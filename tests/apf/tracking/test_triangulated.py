"""A track from keypoints alone, and `apf track --method triangulate`."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import footage
from helpers.commands import fail, run, succeed
from helpers.keypoints import of_poses, world_points, write_openpose
from helpers.shared import shared_data

import apf
import psfs
from apf.body.kinematics import posed_joints
from apf.body.toml import load_body
from apf.formats.trc import read_trc
from apf.keypoints.keypoints import Keypoints, TriangulationConfig
from apf.keypoints.readers.orders import BODY_25, MEDIAPIPE
from apf.tracking.triangulated import TriangulatedConfig, triangulate_track
from psfs.output.video import count_frames

FRAMES = 40
BODY = load_body("song31")
POSES = np.tile(BODY.rest_pose, (FRAMES, 1))
POSES[:, 0] += np.linspace(-0.3, 0.3, FRAMES)
MOVED = POSES.copy()
MOVED[:, :2] += [0.5, 0.7]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sequence with exact keypoints.npz and, for BODY_25, pose/: three cameras."""
    folder = footage.native(tmp_path_factory.mktemp("takes") / "walk", frames=FRAMES)
    rig = psfs.open_sequence(folder).rig
    seen = of_poses(rig, BODY, POSES)
    np.savez(
        folder / "keypoints.npz", keypoints=seen.points, keypoint_names=MEDIAPIPE,
        camera_names=rig.names,
    )  # fmt: skip
    write_openpose(folder / "pose", of_poses(rig, BODY, POSES, BODY_25))
    return folder


def test_exact_keypoints_give_the_exact_points(folder: Path) -> None:
    sequence = psfs.open_sequence(folder)
    keypoints = Keypoints.open(folder, sequence)
    track = triangulate_track(sequence, keypoints)
    np.testing.assert_allclose(track.joints, world_points(BODY, POSES, MEDIAPIPE), atol=1e-4)
    assert track.joint_names[11] == "l_shoulder" and track.poses.shape == (FRAMES, 0)
    assert track.diagnostics["cameras_used"].min() == 3
    assert track.diagnostics["reprojection_error"].max() < 0.01
    named = {tuple(track.joint_names[i] for i in edge) for edge in track.edges}
    assert {("l_elbow", "l_wrist"), ("l_hip", "r_hip"), ("r_ankle", "r_heel")} <= named
    some = triangulate_track(sequence, keypoints, selection=slice(4, 20, 4))
    assert some.frames.tolist() == [4, 8, 12, 16]
    np.testing.assert_array_equal(some.joints, track.joints[4:20:4])
    points = of_poses(sequence.rig, BODY, POSES, noise=0.5, seed=3).points.copy()
    points[1:, 12:18, 5] = np.nan
    noisy = Keypoints(points, MEDIAPIPE, tuple(sequence.rig.names))
    settings = ({}, {"longest_gap": 0.2}, {"low_pass": 2.0})
    raw, holed, smooth = (
        triangulate_track(sequence, noisy, TriangulatedConfig(**each)).joints for each in settings
    )
    assert np.isfinite(raw).all() and np.isnan(holed[12:18, 5]).all()
    errors = [np.linalg.norm(joints - track.joints, axis=-1).mean() for joints in (raw, smooth)]
    assert errors[1] < 0.6 * errors[0]


def test_what_cannot_be_triangulated_is_an_error(folder: Path) -> None:
    sequence = psfs.open_sequence(folder)
    keypoints = Keypoints.open(folder, sequence)
    alone = keypoints.points.copy()
    alone[1:] = np.nan
    with pytest.raises(apf.InputError, match="no keypoint of walk is seen by 2 cameras"):
        triangulate_track(sequence, Keypoints(alone, MEDIAPIPE, keypoints.camera_names))
    limits = TriangulationConfig(min_cameras=4)
    with pytest.raises(apf.InputError, match="seen by 4 cameras that agree within 15 px"):
        triangulate_track(sequence, keypoints, TriangulatedConfig(triangulation=limits))


def command(folder: Path, out: Path, *more: str) -> list[str]:
    given = ["--keypoints", "keypoints.npz"] if "--keypoints" not in more else []
    return ["apf", "track", str(folder), "-o", str(out), "--method", "triangulate", *given, *more]


def test_command_writes_a_track(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    said = succeed(*command(folder, out, "--low-pass", "4", "--frames", "0:30"))
    assert "30 frames triangulated" in said.out and "33 points of 3.0 cameras" in said.out
    track = apf.Track.open(out)
    assert json.loads(track.provenance)["triangulated"]["low_pass"] == 4
    assert len(track) == 30 and read_trc(out / "joints.trc").joints.shape == (30, 33, 3)
    assert count_frames(out / "overlay.mp4") == 30
    again = tmp_path / "again"
    settings = ["--config", str(out / "settings.toml"), "--no-overlay", "--frames", "0:30"]
    succeed("apf", "track", folder, "-o", again, *settings)
    np.testing.assert_array_equal(apf.Track.open(again).joints, track.joints)


def test_command_takes_other_formats_some_cameras_and_several_takes(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = ["--no-overlay", "--frames", "0:3"]
    succeed(*command(folder, tmp_path / "a", *few, "--keypoints", str(folder / "p*")))
    assert len(apf.Track.open(tmp_path / "a")) == 3
    np.savez(folder.parent / "order.npz", keypoints=Keypoints.open(folder).points)
    monkeypatch.chdir(folder.parent)
    two = ["--keypoints", "order.npz", "--cameras", "cam01,cam03"]
    said = succeed(*command(folder, tmp_path / "c", *few, *two)).out
    assert "note: " in said and "3 for cam03" in said
    c = apf.Track.open(tmp_path / "c")
    assert c.diagnostics["cameras_used"].max() == 2
    np.testing.assert_allclose(c.joints, world_points(BODY, POSES[:3], MEDIAPIPE), atol=1e-4)
    footage.native(tmp_path / "other", frames=3)
    flags = ["--method", "triangulate", "--keypoints", "keypoints.npz", *few]
    takes = [str(folder), str(tmp_path / "other")]
    said = run("apf", "track", *takes, "-o", tmp_path / "both", *flags)
    assert said.code == 2 and "other failed" in said.out
    assert "1 of 2 takes failed: other" in said.err
    assert len(apf.Track.open(tmp_path / "both" / "walk")) == 3


@pytest.fixture(scope="module")
def pose_of_two(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """OpenPose's lists of two people at two places; the order of the people changes from picture to
    picture."""
    rig, out = psfs.open_sequence(folder).rig, tmp_path_factory.mktemp("pose_of_two")
    both = [of_poses(rig, BODY, poses, BODY_25) for poses in (POSES, MOVED)]
    points = np.stack([one.points for one in both])
    for view, frame in np.ndindex(points.shape[1:3]):
        points[:, view, frame] = points[:: 1 if (view + frame) % 2 else -1, view, frame]
    write_openpose(
        out, *(replace(one, points=each) for one, each in zip(both, points, strict=True))
    )
    return out


def test_people_are_triangulated_apart(folder: Path, pose_of_two: Path, tmp_path: Path) -> None:
    flags = ["--keypoints", str(pose_of_two), "--people", "auto", "--frames", "5:35"]
    assert "person2: " in succeed(*command(folder, tmp_path / "out", *flags)).out
    people = apf.PeopleTracks.open(tmp_path / "out")
    assert people.counts.tolist() == [2] * 30
    true = [world_points(BODY, poses, people[0].joint_names)[5:35] for poses in (POSES, MOVED)]
    for track in people:
        errors = [np.nanmax(np.linalg.norm(track.joints - joints, axis=-1)) for joints in true]
        assert min(errors) < 1e-3 and max(errors) > 0.5
    assert (tmp_path / "out" / "overlay.mp4").exists()
    said = fail(
        *command(folder, tmp_path / "o", *flags, "--people", "2", "--cameras", "cam01,cam02")
    )
    assert "assigned in all cameras" in said


def test_people_are_tracked_by_keypoints(folder: Path, pose_of_two: Path, tmp_path: Path) -> None:
    flags = ["--keypoints", str(pose_of_two), "--objective", "keypoints", "--frames", "5:7"]
    flags += ["--body", "song31", "--particles", "60", "--layers", "3", "--no-overlay"]
    flags += ["--no-report"]
    succeed("apf", "track", str(folder), "-o", str(tmp_path / "out"), *flags)
    people = apf.PeopleTracks.open(tmp_path / "out")
    assert people.counts.tolist() == [2] * 2
    true = np.array([posed_joints(BODY, poses[5:7]) for poses in (POSES, MOVED)])
    found = np.array([track.joints for track in people])
    both = (np.linalg.norm(found[order] - true, axis=-1) for order in ([0, 1], [1, 0]))
    assert min(away.mean((1, 2)).max() for away in both) < 0.05
    method = apf.Method.create(objective="keypoints", n_particles=60, n_layers=3)
    same = apf.track_people(
        psfs.open_sequence(folder), method=method, body="song31", frames=slice(5, 7),
        keypoints=pose_of_two,
    )  # fmt: skip
    for track, again in zip(people, same, strict=True):  # by the library as by the command
        np.testing.assert_array_equal(track.poses, again.poses)
    assert "none were given" in fail("apf", "track", folder, "-o", tmp_path / "without", *flags[2:])


#: mm, means over shoulders, elbows, wrists, hips, knees and ankles: the shared KEYPOINTS.md.
FIGURES = {"synth_box_4cam": 25, "synth_jacks_6cam": 35}


@pytest.mark.parametrize("name", FIGURES)
def test_the_known_figures(name: str) -> None:
    folder = shared_data(name)
    sequence = psfs.open_sequence(folder)
    keypoints = Keypoints.open(folder, sequence)
    track = triangulate_track(sequence, keypoints, TriangulatedConfig(low_pass=6))
    found = apf.evaluate(track, apf.load_truth(folder / "truth.npz"))
    limbs = [k for k, joint in enumerate(found.joint_names) if joint != "pelvis"]
    assert 1000 * np.nanmean(found.errors[:, limbs]) == pytest.approx(FIGURES[name], abs=1.0)

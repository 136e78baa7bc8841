"""Judging a track without ground truth: wrong limbs and impossible motion, and neither if sound."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import bodies, tracks
from helpers.striders import strider, synthetic_walker

from apf.body.kinematics import posed_cones, posed_joints
from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.evaluation.truth import load_truth
from apf.initialisation.from_joints import fit_to_joints
from apf.keypoints.keypoints import Keypoints
from apf.report.agreement import (
    compare_with_silhouettes,
    measure_explained,
    measure_keypoint_agreement,
)
from apf.report.judged import find_impossible_motion
from apf.report.quality import Quality
from apf.synthetic.walk import Walk
from apf.tracking.track import Track
from cl import Device
from psfs.sequence import Sequence
from psfs.session import Session
from psfs.volume import automatic_grid

Scene = tuple[Session, Track]


@pytest.fixture(scope="module")
def scene(small_walk: Path) -> Scene:
    """A walk with the poses that its true joints have."""
    session = Session(Sequence.open(small_walk), Device.best())
    truth, body, poses = load_truth(small_walk / "truth.npz"), load_body("song31"), []
    for joints in truth.joints:
        named = dict(zip(truth.joint_names, joints, strict=True))
        body, pose, _ = fit_to_joints(body, named)
        poses.append(pose)
    return session, tracked(body, np.stack(poses))


def tracked(body: BodyModel, poses: np.ndarray) -> Track:
    return replace(
        tracks.walker(len(poses), fps=2 * len(poses)),  # lasts as long as limbs need
        poses=poses,
        joints=posed_joints(body, poses),
        body=body,
        diagnostics={"covariance": np.tile(0.02**2 * np.eye(3), (len(poses), 15, 1, 1))},
    )


def judged(scene: Scene, track: Track) -> Quality:
    session, _ = scene
    return Quality(track, compare_with_silhouettes(session, automatic_grid(session), track))


@pytest.fixture(scope="module")
def good(scene: Scene) -> Quality:
    """What is said of the true poses."""
    return judged(scene, scene[1])


def test_a_good_track_looks_good(good: Quality) -> None:
    assert good.verdict == "good" and 0.01 < good.expected_error < 0.04
    assert np.median(good.confidence) > 0.8
    facts = good.facts()
    assert min(facts["body_iou"].values()) > 0.6 and min(facts["voxel_iou"].values()) > 0.7
    assert facts["voxels_explained"] > 0.9
    assert good.lines()[0].startswith("the track looks good: expected joint error ")


@pytest.mark.parametrize(
    ("change", "part"),
    [({"l_upper_arm__ry": -0.9}, "left arm"), ({"l_thigh__ry": 0.7}, "left leg")],
)
def test_a_wrong_limb_is_named(change: dict, part: str, scene: Scene, good: Quality) -> None:
    """In the frames in which it is wrong."""
    track = scene[1]
    poses = track.poses.copy()
    poses[1:4] = bodies.bent(track.its_body, poses[1:4], **change)
    quality = judged(scene, tracked(track.its_body, poses))
    assert quality.expected_error > good.expected_error
    for name in quality.parts:  # an arm of a few pixels may be doubtful without a reason
        new = set(quality.doubtful.get(name, ())) - set(good.doubtful.get(name, ()))
        assert new <= ({1, 2, 3} if name == part else set())
    assert {1, 2, 3} <= set(quality.doubtful[part])
    first, last = quality.facts()["look_at"][part][0]
    assert first <= 1 and last >= 3 and f"look at {part}: frames" in "\n".join(quality.lines())


@pytest.mark.parametrize(("covering", "share"), [(4, 1.0), (3, 1.0), (2, 0.5), (0, 0.5)])
def test_what_cameras_see_behind_the_body(covering: int, share: float, scene: Scene) -> None:
    """A hull of few cameras fills the gaps of somebody who bends. A camera that furniture hides
    the place from says nothing."""
    rig, track = scene[0].rig, scene[1]
    cones = posed_cones(track.its_body, track.poses[:1])[0]
    points = cones[0, :3] + np.array([[0.0, 0.0, 0.0], [0.45, 0.0, 0.0]])
    size = (rig.height, rig.width)
    drawings = [np.full(size, number < covering) for number in range(4)]
    known = np.ones((4, *size), bool)
    assert measure_explained(rig, points, cones, drawings, known) == share
    known[max(0, covering - 1) :] = False
    others = 1.0 if covering > 1 else 0.5
    assert measure_explained(rig, points, cones, drawings, known) == others
    assert np.isnan(measure_explained(rig, points[:0], cones, drawings, known))


def test_unjudged_and_short_tracks_are_not_called_good(scene: Scene, good: Quality) -> None:
    track = scene[1]
    unjudged, short = Quality(track, None), replace(good, track=replace(good.track, fps=30.0))
    for quality, said in (
        (unjudged, "was not compared with the silhouettes"),
        (short, "too short"),
    ):
        assert quality.verdict == "unknown" and said in quality.lines()[0]
    searched = {**track.diagnostics, "limb_margin": np.full((len(track), 4), 0.3)}
    assert Quality(replace(track, diagnostics=searched), None).verdict == "good"


def test_a_track_of_the_opposite_posture_is_bad(scene: Scene) -> None:
    """Doubtful limbs in all frames, which the silhouettes deny as well."""
    track = scene[1]
    changes = {"l_upper_arm__ry": -1.4, "r_upper_arm__ry": -1.4, "l_thigh__ry": 1.2}
    poses = bodies.bent(track.its_body, track.poses, **changes)
    assert judged(scene, tracked(track.its_body, poses)).verdict == "bad"


def test_doubts_and_keypoints_elsewhere_are_not_called_good(good: Quality) -> None:
    doubted = replace(good, doubts=("the keypoints of a and b look exchanged",))
    assert doubted.verdict == "doubtful"
    assert "in doubt because the keypoints of a and b look exchanged" in doubted.lines()
    n = len(good.track)
    assert replace(good, near=np.ones(n)).verdict == "good"
    apart = replace(good, near=np.full(n, 0.8))
    assert apart.verdict == "doubtful" and len(apart.doubtful["keypoints away from the body"]) == n
    assert apart.facts()["doubts"] == ["only 80% of the keypoints are near the body"]
    alone = Quality(good.track, None, np.full(n, 0.02))
    assert alone.verdict == "bad" and "2% of the keypoints near the body" in alone.lines()[0]


def test_the_body_s_own_points_are_near_it(scene: Scene) -> None:
    session, track = scene[0], scene[1]
    pixels = np.stack([camera.project(track.joints)[0] for camera in session.rig])
    points = np.concatenate([pixels, np.full((*pixels.shape[:3], 1), 0.9)], -1)
    names, last = track.joint_names, int(track.frames.max()) + 1
    every = np.full((len(points), last, *points.shape[2:]), np.nan)
    every[:, track.frames] = points
    keypoints = Keypoints(every, tuple(names), tuple(session.rig.names))
    assert measure_keypoint_agreement(track, keypoints, session.rig).min() > 0.9
    away = replace(keypoints, points=every + np.array([60.0, 0.0, 0.0]))
    assert measure_keypoint_agreement(track, away, session.rig).max() < 0.1


def test_lost_frames_and_unsure_ends() -> None:
    """Without any pictures."""
    track = tracks.lose(tracks.walker(30, start=10), [20, 21])
    covariance = np.tile(0.02**2 * np.eye(3), (30, 15, 1, 1))
    covariance[4, track.joint_names.index("r_wrist")] *= 100
    covariance[track.lost] = np.nan
    diagnostics = {**track.diagnostics, "covariance": covariance}
    quality = Quality(replace(track, diagnostics=diagnostics), None)
    assert {what: rows.tolist() for what, rows in quality.doubtful.items()} == {
        "the person, lost": [20, 21],
        "right arm": [4],
    }
    assert quality.verdict == "doubtful" and quality.confidence[20].max() == 0
    assert "2 of 30 frames lost" in quality.lines()[0]
    assert quality.lines()[1:] == [
        "look at the person, lost: frames 30-31",
        "look at right arm: frames 14",
    ]
    assert quality.facts()["body_iou"] is None


def test_frames_without_the_person_are_not_judged() -> None:
    track = tracks.lose(tracks.walker(40), np.arange(10, 21))
    assert Quality(track, None).verdict == "bad"
    assert "11 of 40 frames lost" in Quality(track, None).lines()[0]
    visitor = Quality(track, None, seen=np.delete(track.frames, np.arange(10, 20)))
    assert visitor.doubtful["the person, lost"].tolist() == [20]
    assert visitor.verdict == "unknown"
    said = visitor.lines()[0]
    assert "1 of 30 frames lost" in said and "not there in frames 10-19" in said
    assert visitor.facts()["lost_frames"] == "20"


HALF_TURN = np.diag([-1.0, -1.0, 1.0])


def jumper(rate: float) -> Track:
    """A track whose whole body is thrown 0.4 m up and falls, once a second; its frames per second
    are stated `rate` times too high."""
    track = strider(180)
    flight = np.sqrt(8 * 0.4 / 9.81)
    since = np.clip(track.times % 1.0, 0, flight)
    height = 0.5 * 9.81 * since * (flight - since)
    joints = track.joints[:1] + np.array([0, 0, 1.0]) * height[:, None, None]
    return replace(track, joints=joints, fps=rate * track.fps)


def turned(track: Track) -> Track:
    """The same path by somebody who faces the other way."""
    middle = track.joints[:, [track.joint_names.index("pelvis")]]
    return replace(track, joints=middle + (track.joints - middle) @ HALF_TURN)


def test_impossible_motion() -> None:
    """Of the true joints of `apf synth`'s walker, 3 s of 60 frames/s, and of a jumper."""
    stroll = synthetic_walker(Walk.sample(3, 1.8), 180)
    still = replace(stroll, joints=np.repeat(stroll.joints[:1], len(stroll), axis=0))
    fast = replace(stroll, fps=2.2 * stroll.fps)
    lost = tracks.lose(fast, np.arange(len(fast)))
    for sound in (stroll, jumper(1.0), still, turned(still), lost, fast.select(np.arange(2))):
        assert not find_impossible_motion(sound)
    for track, said in (
        (turned(stroll), "walks backward"),
        (fast, "steps per second"),
        (jumper(2.0), "times gravity"),
    ):
        (line,) = find_impossible_motion(track)
        assert said in line

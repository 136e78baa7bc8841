"""Tracks by keypoints: without pictures' silhouettes, beside voxels, live, and found again."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.keypoints import of_poses

import apf
import psfs
from apf.backend import make_tracker
from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.evaluation.evaluate import evaluate
from apf.evaluation.truth import load_truth
from apf.filters.config import FilterConfig
from apf.filters.method import Method
from apf.initialisation.from_keypoints import start_from_keypoints
from apf.keypoints.keypoints import Keypoints
from apf.scene import Scene
from apf.tracking.pipeline import TrackingRun, TrackingTask, track_people
from apf.tracking.settings import TakeSettings
from apf.tracking.take import track_take
from cl import Device
from psfs.cameras.camera import CameraRig
from psfs.session import Session

BODY = load_body("song31")
RIG = scenes.ring(4, size=(640, 480), radius=4.0)
N = 10


def poses() -> np.ndarray:
    """(N, D) a person who turns while an arm goes up."""
    time, rest = np.arange(N) / N, np.tile(BODY.rest_pose, (N, 1))
    return bodies.bent(BODY, rest, pelvis__rz=0.6 * time, l_upper_arm__rx=1.5 * time)


class Blind:
    """A sequence whose pictures nobody looks at."""

    rig, fps, folder, name = RIG, 30.0, Path("nowhere"), "nowhere"

    def __len__(self) -> int:
        return N


def blind_session(device: Device, rig: CameraRig = RIG) -> Session:
    sequence = Blind()
    sequence.rig = rig
    return Session(sequence, device)  # type: ignore[arg-type]


def tracked(device: Device, rig: CameraRig, keypoints: Keypoints) -> apf.Track:
    method = Method.create(objective="keypoints", n_particles=60, n_layers=5)
    settings = TakeSettings(method=method, keypoints=keypoints, template=BODY)
    return track_take(blind_session(device, rig), settings).tracks[0]


def miss(track: apf.Track) -> float:
    """m, mean over frames and joints."""
    truth = posed_joints(BODY, poses()[track.frames])
    return float(np.linalg.norm(track.joints - truth, axis=-1).mean())


def test_a_body_is_tracked_from_a_frame_to_both_ends(device: Device) -> None:
    keypoints = of_poses(RIG, BODY, poses(), noise=2.0)
    method = Method.create(objective="keypoints", n_particles=100, n_layers=5).with_keypoints(1)
    session = blind_session(device)
    points = start_from_keypoints(RIG, keypoints, BODY, session.frames).observations
    task = TrackingTask(BODY, poses()[4], method, [0], points, frame=4)
    kept: list[int] = []
    run = TrackingRun(session, task, lambda parts: kept.extend(parts[0].frames))
    (found,) = track_people([run])
    assert found.tracks[0].frames.tolist() == sorted(kept) == list(range(N))
    assert miss(found.tracks[0]) < 0.03 and found.tracks[0].present.all()


def test_beside_voxels_the_body_is_measured_and_tracked_again(
    small_walk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence, truth = psfs.open_sequence(small_walk), load_truth(small_walk / "truth.npz")
    points = np.ones((4, *truth.joints.shape))
    points[..., :2] = [camera.project(truth.joints)[0] for camera in sequence.rig]
    keypoints = Keypoints(points, truth.joint_names, tuple(sequence.rig.names))
    templates, stages = list[BodyModel](), list[str]()

    def start(
        rig: CameraRig, keypoints: Keypoints, template: BodyModel, *more: Any, **rest: Any
    ) -> Any:
        templates.append(template)
        return start_from_keypoints(rig, keypoints, template, *more, **rest)

    monkeypatch.setattr("apf.tracking.take.start_from_keypoints", start)
    method = Method.create(n_particles=60, n_layers=4)
    settings = TakeSettings(method=method, keypoints=keypoints)
    track = track_take(Session(sequence, Device.best()), settings, stages.append).tracks[0]
    assert "tracking again" in stages and track.surface is not None
    default, measured = templates
    assert default.name == measured.name and "l_foot.ry" in measured.dof_names
    assert evaluate(track, truth).mean_error < 0.05


def test_the_lost_are_found_by_their_keypoints(device: Device) -> None:
    """Half of the frames show nobody, then somebody elsewhere who looks the other way."""
    moved = poses()
    moved[7:, 0] += 1.0
    moved[7:, BODY.dof_names.index("pelvis.rz")] += 2.5
    keypoints = of_poses(RIG, BODY, moved)
    gone = replace(keypoints, points=keypoints.points.copy())
    gone.points[:, 4:7] = np.nan
    track = tracked(device, RIG, gone)
    assert track.lost.tolist() == [False] * 4 + [True] * 3 + [False] * 3
    assert (track.present == ~track.lost).all() and "present" in track.diagnostics
    truth = posed_joints(BODY, moved[7:])
    assert np.linalg.norm(track.joints[7:] - truth, axis=-1).mean() < 0.05


def test_two_cameras_of_six_move_nobody(device: Device) -> None:
    """Two that see him elsewhere, in a frame in which the others see nobody: he is lost there, and
    stays where he was."""
    rig = scenes.ring(6, size=(640, 480), radius=4.0)
    still = np.tile(BODY.rest_pose, (N, 1))
    points = of_poses(rig, BODY, still).points.copy()
    points[2:, 5] = np.nan
    points[:2, 5] = of_poses(rig, BODY, still + 0.6 * (np.arange(BODY.n_dof) == 0)).points[:2, 5]
    keypoints = replace(of_poses(rig, BODY, still), points=points)
    track = tracked(device, rig, keypoints)
    assert np.flatnonzero(track.lost).tolist() == [5]
    away = np.linalg.norm(track.joints - posed_joints(BODY, still), axis=-1)
    assert away.mean(1).max() < 0.05


def test_live_keypoints_frame_by_frame(device: Device) -> None:
    """As a callback gives them: a tracker's step takes each frame's."""
    known = start_from_keypoints(RIG, of_poses(RIG, BODY, poses(), noise=2.0), BODY, range(N))
    config = FilterConfig.create(n_particles=100, n_layers=5, keypoints_weight=4.0)
    method = Method(objective="keypoints", filter=config.scale_to_rate(30))
    tracker: Any = make_tracker(Scene(device, RIG, None, known.body), method)
    tracker.start(known.anchored[1])
    for points in known.keypoints.points.swapaxes(0, 1):
        estimate = tracker.step(None, keypoints=known.model.observations(points))
    away = estimate.joints - posed_joints(BODY, poses()[-1:])[0]
    assert np.linalg.norm(away, axis=-1).mean() < 0.04

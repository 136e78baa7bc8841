"""The programs that are compared: each takes a sequence's keypoints and returns 12 joints."""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

import apf
from apf.filters.method import Method
from apf.formats.trc import JointSeries, read_trc
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.readers.orders import MEDIAPIPE
from apf.tracking.config import TriangulatedConfig
from apf.tracking.smoothing import smooth_track
from apf.tracking.triangulated import fill_gaps, triangulate_track
from cl import Device, InputError
from peers.environments import run_script
from peers.figures import LIMB_JOINTS, select_limb_joints
from psfs.sequence import Sequence

#: The joints that all have, and the keypoints of a pose network that they are.
JOINTS = {name: f"{'left' if name[0] == 'l' else 'right'}_{name[2:]}" for name in LIMB_JOINTS}
_LIMBS = (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
#: Least visibility of a keypoint that is triangulated, as in Pose2Sim's demo (its
#: likelihood_threshold_triangulation).
_VISIBLE = 0.3
#: FreeMoCap's post-processing: gaps filled linearly, then a Butterworth filter of order 4 at 7 Hz,
#: forward and backward.
_FREEMOCAP_ORDER, _FREEMOCAP_HZ = 4, 7.0
#: Our triangulation's low-pass, Hz: Pose2Sim's.
_LOW_PASS = 6.0


@dataclass(frozen=True, eq=False)
class Task:
    """A sequence with keypoints, and where to work. pythons: of the peers' environments."""

    sequence: Sequence
    folder: Path
    pythons: dict[str, Path]
    device: Device | None = None
    seed: int = 0

    @property
    def keypoints(self) -> Keypoints:
        return Keypoints.open(self.sequence.folder, self.sequence)


@dataclass(frozen=True, eq=False)
class Found:
    """Joints, and the seconds that they took of the processor (None: of a GPU) and by the clock."""

    joints: JointSeries
    cpu: float | None
    clock: float


def run_pose2sim(task: Task, undistort: bool) -> Found:
    """Person association, triangulation and filtering by Pose2Sim, with its demo's settings;
    undistort: with lens distortions, which the demo leaves out."""
    project = task.folder / "pose2sim"
    shutil.rmtree(project, ignore_errors=True)
    _write_project(task, project, undistort)
    seconds = run_script(task.pythons["pose2sim"], "run_pose2sim.py", str(project))
    files = sorted((project / "pose-3d").glob("*filt*.trc"))
    if not files:
        raise InputError(f"{project}: Pose2Sim wrote no filtered TRC")
    series = read_trc(_with_true_count(files[0]), "pose2sim")
    # Its body has "Lknee"; all others are LHip, RKnee, ...
    names = {name.lower(): place for place, name in enumerate(series.joint_names)}
    columns = [names[joint.replace("_", "")] for joint in JOINTS]
    return _make_found(series.joints[:, columns], series.frames, task, seconds)


def _with_true_count(path: Path) -> Path:
    """Return a copy of a TRC whose header promises the rows that there are: Pose2Sim's filter
    leaves out the last frame, and not in the header."""
    lines = path.read_text().splitlines()
    header = lines[2].split("\t")
    header[2] = str(sum(bool(line.strip()) for line in lines[5:]))
    copy = path.with_name("counted.trc")
    copy.write_text("\n".join([*lines[:2], "\t".join(header), *lines[3:]]) + "\n")
    return copy


def _write_project(task: Task, project: Path, undistort: bool) -> None:
    """Write a project folder: Config.toml after Pose2Sim's demo, calibration, keypoints as OpenPose
    writes them."""
    site = next((task.pythons["pose2sim"].parent.parent / "lib").glob("python*/site-packages"))
    config = (site / "Pose2Sim" / "Demo_SinglePerson" / "Config.toml").read_text()
    changes = {
        "frame_rate": f"{round(task.sequence.fps)}",
        "frame_range": "'all'",  # not cut to the frames with small errors
        "pose_model": "'BLAZEPOSE'",  # MediaPipe's points, which are given
        "tracked_keypoint": "'RShoulder'",  # they have no neck
        "display_figures": "false",
        "save_filt_plots": "false",
        "make_c3d": "false",
    }
    for name, value in changes.items():
        config, count = re.subn(rf"(?m)^(\s*{name}\s*=\s*)[^#\n]*", rf"\g<1>{value} ", config)
        if not count:
            raise InputError(f"Pose2Sim's demo has no setting {name}; expected another version")
    if undistort:  # read from here, though the demo has the line under [pose]
        config = config.replace(
            "[triangulation]\n", "[triangulation]\nundistort_points = true\n", 1
        )
    calibration = project / "calibration"
    calibration.mkdir(parents=True)
    (project / "Config.toml").write_text(config)
    shutil.copy(task.sequence.folder / "calibration.toml", calibration / "Calib.toml")
    keypoints = task.keypoints
    points = order_points(_raw_points(task), list(keypoints.names))
    for view, camera in enumerate(task.sequence.rig.names):
        folder = project / "pose" / f"{camera}_json"
        folder.mkdir(parents=True)
        for frame in range(keypoints.n_frames):
            shown = np.nan_to_num(points[view, frame])
            person = {"person_id": [-1], "pose_keypoints_2d": shown.ravel().tolist()}
            text = json.dumps({"version": 1.3, "people": [person]})
            (folder / f"{camera}_{frame:06d}.json").write_text(text)


def order_points(points: np.ndarray, names: list[str]) -> np.ndarray:
    """Return points (V, F, P, 3) in the order of MediaPipe's 33, which Pose2Sim expects; those that
    are missing have no confidence."""
    ordered = np.zeros((*points.shape[:2], len(MEDIAPIPE), 3))
    for place, name in enumerate(MEDIAPIPE):
        if name in names:
            ordered[:, :, place] = points[:, :, names.index(name)]
    return ordered


def _raw_points(task: Task) -> np.ndarray:
    """Return (V, F, P, 3) x, y, visibility as stored in keypoints.npz."""
    with np.load(task.sequence.folder / "keypoints.npz") as stored:
        order = [list(stored["camera_names"]).index(name) for name in task.sequence.rig.names]
        return stored["keypoints"][order].astype(float)


def run_anipose(task: Task, kind: str) -> Found:
    """Triangulation by aniposelib: "optimised" over frames and limbs, as Anipose does, or "linear"
    with FreeMoCap's post-processing."""
    with np.load(task.sequence.folder / "keypoints.npz") as stored:
        columns = [list(stored["keypoint_names"]).index(name) for name in JOINTS.values()]
    points = _raw_points(task)[:, :, columns]
    points[points[..., 2] < _VISIBLE, :2] = np.nan
    names = list(JOINTS)
    limbs = [[names.index(f"{s}_{a}"), names.index(f"{s}_{b}")] for s in "lr" for a, b in _LIMBS]
    task.folder.mkdir(parents=True, exist_ok=True)
    given, made = task.folder / "anipose_in.npz", task.folder / f"anipose_{kind}.npz"
    scores = np.nan_to_num(points[..., 2])
    np.savez(given, points=points[..., :2], scores=scores, limbs=np.array(limbs))
    calibration = task.sequence.folder / "calibration.toml"
    arguments = (str(given), str(calibration), str(made), kind)
    seconds = run_script(task.pythons["aniposelib"], "run_aniposelib.py", *arguments)
    with np.load(made) as out:
        joints = out["points"]
    if kind == "linear":
        filled = fill_gaps(joints, None)
        band = butter(_FREEMOCAP_ORDER, _FREEMOCAP_HZ, fs=task.sequence.fps, output="sos")
        joints = sosfiltfilt(band, filled, axis=0)
    return _make_found(joints, np.arange(len(joints)), task, seconds)


def run_ours(task: Task, what: str) -> Found:
    """Track by ours; joints are those of `apf export`, smoothed, without limbs reported as lost.
    what: triangulation, voxels, keypoints (in the place of voxels) or both."""
    cpu, clock = time.process_time(), time.perf_counter()
    if what == "triangulation":
        config = TriangulatedConfig(low_pass=_LOW_PASS)
        track = triangulate_track(task.sequence, task.keypoints, config)
    else:
        objective = "keypoints" if what == "keypoints" else "voxel"
        method = Method.create(objective=objective, seed=task.seed)
        keypoints = None if what == "voxels" else task.keypoints
        track = smooth_track(
            apf.track(task.sequence, device=task.device, method=method, keypoints=keypoints)
        )
    seconds = {"cpu": time.process_time() - cpu, "clock": time.perf_counter() - clock}
    return _make_found(select_limb_joints(track).joints, track.frames, task, seconds)


def _make_found(
    joints: np.ndarray, frames: np.ndarray, task: Task, seconds: dict[str, float]
) -> Found:
    series = JointSeries(tuple(JOINTS), np.asarray(joints, float), task.sequence.fps, frames)
    on_gpu = task.device is not None and task.device.info.kind == "gpu"
    return Found(series, None if on_gpu else seconds["cpu"], seconds["clock"])


#: The programs by name.
PROGRAMS: dict[str, Callable[[Task], Found]] = {
    "Pose2Sim, as its demo": lambda task: run_pose2sim(task, undistort=False),
    "Pose2Sim, undistorted": lambda task: run_pose2sim(task, undistort=True),
    "aniposelib, optimised": lambda task: run_anipose(task, "optimised"),
    "aniposelib, FreeMoCap's filter": lambda task: run_anipose(task, "linear"),
    "ours: triangulation": lambda task: run_ours(task, "triangulation"),
    "ours: keypoints": lambda task: run_ours(task, "keypoints"),
    "ours: voxels": lambda task: run_ours(task, "voxels"),
    "ours: both": lambda task: run_ours(task, "both"),
}
#: The environment that a program needs.
NEEDS = {
    name: "pose2sim" if name.startswith("Pose2Sim") else "aniposelib"
    for name in PROGRAMS
    if not name.startswith("ours")
}
#: Keeps libraries of the peers from using all cores at once, so that seconds compare.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
os.environ.update({name: os.environ.get(name, value) for name, value in ONE_THREAD.items()})

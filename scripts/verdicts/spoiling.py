"""Ways to spoil a take so that its track becomes doubtful or wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from spoil_keypoints import spoilt

from apf.api import DEFAULT_BODY
from apf.body import load_body
from apf.body.model import BodyModel
from apf.evaluation.joint_names import match_joints
from apf.formats.trc import JointSeries
from apf.initialisation.from_joints import fit_to_joints
from apf.keypoints import Keypoints
from apf.keypoints.landmarks import find_landmarks
from psfs.cameras.camera import CameraRig
from psfs.sequence import Sequence

#: Of footage: nothing; forward only; three or two cameras; cameras turned by 1 degree; a camera 6
#: frames early, or 3 late; every fourth frame; a poor search; a start that faces backward or to the
#: side, or with a body that is a sixth too tall.
FOOTAGE = (
    "sound", "one way", "three cameras", "two cameras", "turned cameras", "early camera",
    "slow", "poor search", "wrong start", "late camera", "quarter turn", "tall body",
)  # fmt: skip
#: Of keypoints: nothing; forward only; a fifth, half or all of them anywhere; left and right
#: exchanged in one camera or all; two cameras exchanged; one late; coarse ones; those of a camera
#: that hangs after a third of the take; all of a camera aside.
KEYPOINTS = (
    "sound", "one way", "outliers", "half outliers", "anywhere", "exchanged", "all exchanged",
    "two cameras exchanged", "late camera", "coarse", "hangs", "aside",
)  # fmt: skip
#: Starts that are given: the turn about the vertical, degrees, and the scale.
GIVEN_STARTS = {"wrong start": (180, 1.0), "quarter turn": (90, 1.0), "tall body": (0, 7 / 6)}
_LATE, _EARLY = 5, 6
#: Standard deviation of coarse keypoints, as a share of the picture's height; that of the turn of a
#: camera about each axis, rad.
_COARSE, _TURN = 0.04, np.radians(1.0)
#: Way by which all keypoints of a camera lie aside, as a share of the picture's height.
_ASIDE = 0.05
#: Error, px, and confidence of keypoints made from the truth.
_ERROR, _CONFIDENCE = 4.0, 0.9


def spoil_footage(sequence: Sequence, how: str, seed: int) -> Sequence:
    """Return a sequence with one of the faults named in `FOOTAGE`."""
    names, random = sequence.rig.names, np.random.default_rng(seed)
    if how in ("three cameras", "two cameras"):
        n = {"three": 3, "two": 2}[how.split()[0]]
        return sequence.with_cameras([names[k * len(names) // n] for k in range(n)])
    if how in ("early camera", "late camera"):
        shift = _EARLY if how == "early camera" else -_EARLY // 2
        return sequence.synchronise({names[int(random.integers(len(names)))]: shift})
    if how == "turned cameras":
        cameras = []
        for camera in sequence.rig:
            R = cv2.Rodrigues(random.normal(0, _TURN, 3))[0] @ camera.R
            cameras.append(replace(camera, R=R, t=-R @ camera.centre))
        return sequence.with_rig(CameraRig(tuple(cameras)))
    return sequence


def spoil_start(truth: JointSeries, frame: int, how: str) -> tuple[BodyModel, np.ndarray]:
    """Return the body and its true pose (D,) in a frame, spoilt in one of `GIVEN_STARTS`."""
    degrees, scale = GIVEN_STARTS[how]
    row = int(np.flatnonzero(truth.frames == frame)[0])
    joints = {name: truth.joints[row, k] for name, k in match_joints(truth.joint_names).items()}
    middle = 0.5 * (joints["l_hip"] + joints["r_hip"])
    turn = scale * cv2.Rodrigues(np.array([0, 0, np.radians(degrees)]))[0]
    spoilt = {name: middle + turn @ (place - middle) for name, place in joints.items()}
    body, pose, _ = fit_to_joints(load_body(DEFAULT_BODY), spoilt)
    return body, pose


def open_keypoints(sequence: Sequence, truth: JointSeries, seed: int) -> Keypoints:
    """Return a sequence's keypoints; if it has none, its true joints with an error of 4 px."""
    if Path(sequence.folder / "keypoints.npz").exists():
        return Keypoints.open(sequence.folder, sequence)
    pixels = np.stack([camera.project(truth.joints)[0] for camera in sequence.rig])
    pixels = pixels + np.random.default_rng(seed).normal(0, _ERROR, pixels.shape)
    points = np.concatenate([pixels, np.full((*pixels.shape[:3], 1), _CONFIDENCE)], -1)
    sides = {"l_": "left_", "r_": "right_"}
    names = [sides[n[:2]] + n[2:] if n[:2] in sides else n for n in truth.joint_names]
    return Keypoints(points, tuple(names), tuple(sequence.rig.names))


def spoil_keypoints(keypoints: Keypoints, rig: CameraRig, how: str, seed: int) -> Keypoints:
    """Return keypoints with one of the faults named in `KEYPOINTS`."""
    random = np.random.default_rng(seed)
    view = int(random.integers(len(rig)))
    if how in ("outliers", "exchanged"):
        return spoilt(keypoints, how, view, seed)
    points = keypoints.points.copy()
    sizes = np.array([camera.size for camera in rig], float)[:, None, None]
    if how in ("half outliers", "anywhere"):
        wrong = random.random(points.shape[:3]) < (0.5 if how == "half outliers" else 1.0)
        places = random.uniform(0, 1, (*points.shape[:3], 2)) * sizes
        points[..., :2] = np.where(wrong[..., None], places, points[..., :2])
    elif how == "all exchanged":
        points = points[:, :, exchange_sides(keypoints.names)]
    elif how == "two cameras exchanged":
        other = (view + 1) % len(rig)
        points[[view, other]] = points[[other, view]]
    elif how == "late camera":
        points[view] = np.roll(points[view], _LATE, axis=0)
    elif how == "hangs":
        begin = points.shape[1] // 3
        points[view, begin:] = points[view, begin]
    elif how == "aside":
        points[view, ..., 0] += _ASIDE * sizes[view, 0, 0, 1]
    elif how == "coarse":
        points[..., :2] += random.normal(0, 1, points[..., :2].shape) * _COARSE * sizes[..., 1:]
    return replace(keypoints, points=points)


def exchange_sides(names: tuple[str, ...]) -> np.ndarray:
    """Return the columns (K,) of the same points on the other side, or of the points themselves."""
    own = find_landmarks(names)
    column_of = {landmark.name: column for column, landmark in own.items()}
    columns = np.arange(len(names))
    for column, landmark in own.items():
        columns[column] = column_of.get(landmark.partner or "", column)
    return columns

"""Figures of joints against the truth: error, gaps, jitter, sliding of standing feet."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from apf.evaluation.evaluate import LOST_JOINT, evaluate
from apf.formats.trc import JointSeries
from apf.tracking.smoothing import smooth_track
from apf.tracking.track import Track
from psfs.common.numbers import find_true_runs

#: A true foot stands if it is slower than this, m/s, and not higher, m, above its lowest position;
#: least number of frames of a stance.
_STILL, _LOW, _SHORTEST = 0.3, 0.04, 6
_SIDES = ("l", "r")
#: The joints that are measured: those that keypoints have, too.
LIMB_JOINTS = tuple(
    f"{side}_{joint}"
    for side in _SIDES
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
)


@dataclass(frozen=True)
class Figures:
    """Figures of twelve joints.

    mean, rest: mm, with and without each joint's constant offset in the body's own frame. far:
    share of the joint-frames that are farther than 150 mm, of those that there are. gaps: share of
    the joint-frames of the truth that there are not. jitter: mm/frame^2, mean second difference of
    the error. skating: mm, mean over the stances of the truth of the distance that the ankle
    travels along the floor. joints: mm, mean of each.
    """

    mean: float
    rest: float
    far: float
    gaps: float
    jitter: float
    skating: float
    joints: dict[str, float]


def measure(found: JointSeries, truth: JointSeries) -> Figures:
    """Return the figures of a program's joints. Raises InputError if nothing can be compared."""
    evaluation = evaluate(found, truth)
    errors = evaluation.errors[:, [n in found.joint_names for n in evaluation.joint_names]]
    names = [name for name in evaluation.joint_names if name in found.joint_names]
    columns = [evaluation.joint_names.index(name) for name in names]
    whole = np.full((len(truth.frames), len(found.joint_names), 3), np.nan)
    _, rows, at = np.intersect1d(found.frames, truth.frames, return_indices=True)
    whole[at] = found.joints[rows]
    true = truth.joints[:, [truth.joint_names.index(name) for name in found.joint_names]]
    known = np.isfinite(errors)
    there, wanted = np.isfinite(whole).all(-1), np.isfinite(true).all(-1)
    second = np.linalg.norm(np.diff(whole - true, 2, axis=0), axis=-1)
    return Figures(
        mean=1000 * float(np.mean(errors[known])),
        rest=1000 * float(np.nanmean(evaluation.constant_and_rest[1][columns])),
        far=float(np.mean(errors[known] > LOST_JOINT)),
        gaps=float(np.mean(~there[wanted])),
        jitter=1000 * float(np.nanmean(second)),
        skating=_skating(replace(found, joints=whole, frames=truth.frames), truth),
        joints={n: 1000 * float(np.nanmean(errors[:, k])) for k, n in enumerate(names)},
    )


def measure_track(track: Track, truth: JointSeries) -> Figures:
    """Return the figures of a track as `apf export` writes it: smoothed if it has a body, without
    limbs reported as lost."""
    return measure(select_limb_joints(track if track.body is None else smooth_track(track)), truth)


def select_limb_joints(track: Track) -> JointSeries:
    """Return the twelve joints of a track, without limbs reported as lost."""
    points = track.points if track.body is not None else track
    columns = [points.joint_names.index(name) for name in LIMB_JOINTS]
    return JointSeries(LIMB_JOINTS, points.joints[:, columns], track.fps, track.frames)


def find_true_stances(truth: JointSeries) -> np.ndarray | None:
    """Return (F, 2) bool: where the true left and right foot stand; None without ankles or toes."""
    names = list(truth.joint_names)
    if not {f"{side}_{joint}" for side in _SIDES for joint in ("ankle", "toe")} <= set(names):
        return None
    stands = np.zeros((len(truth.joints), 2), bool)
    for foot, side in enumerate(_SIDES):
        ankle, toe = (truth.joints[:, names.index(f"{side}_{j}")] for j in ("ankle", "toe"))
        speeds = [np.linalg.norm(np.gradient(p, axis=0), axis=1) * truth.fps for p in (ankle, toe)]
        low = ankle[:, 2] < np.percentile(ankle[:, 2], 10) + _LOW
        stands[:, foot] = (np.max(speeds, axis=0) < _STILL) & low
    return stands


def measure_travels(series: JointSeries, stands: np.ndarray) -> list[float]:
    """Return the greatest distance, mm, along the floor between two places of an ankle in each
    stance of at least `_SHORTEST` known frames. stands: (F, 2) bool, in the frames of `series`."""
    travels = []
    for foot, side in enumerate(_SIDES):
        ankle = series.joints[:, series.joint_names.index(f"{side}_ankle"), :2]
        for stance in find_true_runs(stands[:, foot]):
            places = ankle[stance][np.isfinite(ankle[stance]).all(-1)]
            if len(places) >= _SHORTEST:
                apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
                travels.append(1000 * float(apart.max()))
    return travels


def _skating(series: JointSeries, truth: JointSeries) -> float:
    """Return the mean travel, mm, of the ankles over the true stances, in the truth's frames; NaN
    if there are none, or no toes."""
    stands = find_true_stances(truth)
    travels = [] if stands is None else measure_travels(series, stands)
    return float(np.mean(travels)) if travels else float("nan")

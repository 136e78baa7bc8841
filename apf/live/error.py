"""Errors of live poses: against the truth of their frame, and of the moment at which they are
known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from apf.evaluation.evaluate import evaluate
from apf.formats.trc import JointSeries
from apf.tracking.track import Track
from psfs.common.numbers import json_number


def live_errors(track: Track, truth: JointSeries, latencies: np.ndarray) -> dict[str, float | None]:
    """Return mean errors, mm, over joints and poses.

    error_mm: against the truth of the frame, which is the error of tracking. error_when_known_mm:
    against the truth `latencies` (F,) s later, when the pose was known; poses without truth at that
    time are left out. Raises InputError as `evaluate` does.
    """
    errors = {"error_mm": evaluate(track, truth).mean_error, "error_when_known_mm": np.nan}
    later = truth_later(truth, track.frames, latencies)
    if np.isfinite(later.joints).any():
        errors["error_when_known_mm"] = evaluate(track, later).mean_error
    return {name: json_number(1000 * error, 2) for name, error in errors.items()}


def truth_later(truth: JointSeries, frames: np.ndarray, seconds: np.ndarray) -> JointSeries:
    """Return the true joints `seconds` (F,) after the frames `frames` (F,), linearly interpolated;
    NaN outside the truth."""
    when = frames + seconds * truth.fps
    flat = truth.joints.reshape(len(truth.frames), -1)
    moved = [np.interp(when, truth.frames, column, np.nan, np.nan) for column in flat.T]
    joints = np.stack(moved, -1).reshape(len(frames), *truth.joints.shape[1:])
    return replace(truth, joints=joints, frames=np.asarray(frames))

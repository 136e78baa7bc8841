"""Smooth a finished track in time, and hold the feet that stand.

The model of every degree of freedom is a value whose velocity is driven by white noise (an
integrated Wiener process), measured with the standard deviation that the tracker states. A Kalman
filter runs forward and the smoother of Rauch, Tung & Striebel (1965) backward. A joint that turns
about three axes is smoothed as unit quaternions: its angles may change to others of the same
rotation from one frame to the next, and half way between the two the limb points elsewhere.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy

from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel, FreeAxis
from apf.tracking.config import SmoothingConfig
from apf.tracking.foot_contact import (
    detect_standing,
    find_ankles,
    hold_feet,
    raise_soles,
)
from apf.tracking.track import Track
from cl import InputError
from psfs.common.numbers import find_true_runs

#: Least deviation, as a share of the median of the stated ones; smaller ones are replaced by it.
_LEAST_DEVIATION = 0.1


def smooth_track(track: Track, config: SmoothingConfig | None = None) -> Track:
    """Return `track` with smooth poses within the limits of its body, and with the joints of these
    poses.

    `Track.standing` of the result says in which frames the feet stand and are held. Lost frames
    stay as they are, flagged, and nothing is smoothed across them. The standard deviation of each
    angle weights a frame against its neighbours. Raises InputError if the track is smoothed already
    or does not hold its body.
    """
    config = config or SmoothingConfig()
    if track.smoothing is not None:
        raise InputError("the track is smoothed already; expected one as it was tracked")
    body, times = track.its_body, track.times
    deviation = track.diagnostics.get("deviation", np.ones_like(track.poses))
    relative = deviation / np.maximum(np.median(deviation, axis=0), 1e-12) if len(track) else 1.0
    variance = np.maximum(relative, _LEAST_DEVIATION) ** 2
    poses = unwrap_angles(track.poses, body)
    joints = {tuple(axis.dof for axis in axes): axes for axes in _find_ball_joints(body)}
    single = [dof for dof in range(body.n_dof) if not any(dof in dofs for dofs in joints)]
    for run in find_unbroken_parts(track):
        angles, noise = poses[run], variance[run]
        angles[:, single] = smooth_series(angles[:, single], noise[:, single], times[run], config)
        for dofs, axes in joints.items():
            mean = noise[:, dofs].mean(1)
            angles[:, dofs] = _smooth_rotations(angles[:, dofs], axes, mean, times[run], config)
    poses = np.where(track.lost[:, None], track.poses, np.clip(poses, body.lower, body.upper))
    diagnostics = dict(track.diagnostics)
    if config.lag is None and config.hold_feet:
        poses, diagnostics["standing"] = _hold_feet(track, poses)
        poses[~track.lost] = raise_soles(body, poses[~track.lost])
    provenance = json.loads(track.provenance)
    provenance["smoothing"] = {
        "mode": "whole sequence" if config.lag is None else "fixed lag",
        "lag_frames": config.lag,
        "cutoff_hz": config.cutoff,
        "feet": "held" if "standing" in diagnostics else "free",
    }
    return replace(
        track,
        poses=poses,
        joints=posed_joints(body, poses),
        diagnostics=diagnostics,
        provenance=json.dumps(provenance),
    )


def _hold_feet(track: Track, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return smooth `poses` (F, D) in which standing feet are held, and which feet stand: (F, 2)
    bool."""
    body, times = track.its_body, track.times
    if not find_ankles(body):
        return poses, track.standing
    ankles = posed_joints(body, poses)[:, find_ankles(body)]
    stands = detect_standing(np.where(track.lost[:, None, None], np.nan, ankles), times)
    for run in find_unbroken_parts(track):
        poses[run] = hold_feet(body, poses[run], times[run], stands[run])
    return poses, stands


def unwrap_angles(poses: np.ndarray, body: BodyModel) -> np.ndarray:
    """Return a copy of `poses` (F, .., D) whose unlimited angles are unwrapped along the first
    axis, see `np.unwrap`."""
    poses = np.array(poses, np.float64)
    free = [dof for dof in body.angles if np.isinf([body.lower[dof], body.upper[dof]]).all()]
    poses[..., free] = np.unwrap(poses[..., free], axis=0)
    return poses


def _find_ball_joints(body: BodyModel) -> Iterator[list[FreeAxis]]:
    """Yield the rotational axes of each bone that turns about three, in their order."""
    for bone in body.bones:
        axes = [axis for axis in bone.axes if axis.kind.startswith("r")]
        if len({axis.kind for axis in axes}) == len(axes) == 3:
            yield axes


def _smooth_rotations(
    angles: np.ndarray,
    axes: list[FreeAxis],
    variance: np.ndarray,
    times: np.ndarray,
    config: SmoothingConfig,
) -> np.ndarray:
    """Smooth the rotations that angles (F, 3) about `axes` make; variance (F,), see
    `smooth_series`. Of the two triples of angles that make a smooth rotation, return that nearer to
    the given one."""
    order = "".join(axis.kind[1] for axis in axes).upper()
    signs = np.array([axis.sign for axis in axes])
    quaternions = scipy.spatial.transform.Rotation.from_euler(order, angles * signs).as_quat()
    turned_over = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0  # q and -q are the same
    quaternions[1:] *= np.where(np.cumsum(turned_over) % 2, -1.0, 1.0)[:, None]
    smooth = smooth_series(quaternions, np.tile(variance[:, None], 4), times, config)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Gimbal lock")  # any of these angles will do
        first = scipy.spatial.transform.Rotation.from_quat(smooth).as_euler(order)
    other = np.pi - first
    other[:, [0, 2]] = first[:, [0, 2]] + np.pi
    both = np.stack([first, other]) * signs
    both += 2 * np.pi * np.round((angles - both) / (2 * np.pi))
    nearer = np.argmin(np.linalg.norm(both - angles, axis=2), axis=0)
    return both[nearer, np.arange(len(angles))]


def find_unbroken_parts(track: Track) -> list[slice]:
    """Return the maximal runs of frames without a lost frame."""
    return find_true_runs(~track.lost)


def smooth_series(
    values: np.ndarray, variance: np.ndarray, times: np.ndarray, config: SmoothingConfig
) -> np.ndarray:
    """Smooth values (F, D) at `times` (F,) s; variance (F, D): of each value, up to a common
    factor."""
    n = len(values)
    if n < 3:
        return values
    steps = np.diff(times)
    # Forward and backward together, the filter halves the amplitude at the frequency w at which its
    # gain is 1 / (1 + variance dt w^4 / strength), dt the time between samples.
    strength = np.median(steps) * (2 * np.pi * config.cutoff) ** 4
    moves = [_make_transition(dt, strength) for dt in steps]
    states, covariances = _run_kalman_filter(values, variance, moves)
    if config.lag is None:
        return _run_rts_smoother(states, covariances, moves)[:, :, 0]
    out = np.empty_like(values)
    for i in range(n):
        end = min(n, i + config.lag + 1)
        out[i] = _run_rts_smoother(states[i:end], covariances[i:end], moves[i : end - 1])[0, :, 0]
    return out


def _make_transition(dt: float, strength: float) -> tuple[np.ndarray, np.ndarray]:
    """Return transition and noise covariance of (value, velocity) over `dt` s."""
    transition = np.array([[1.0, dt], [0.0, 1.0]])
    noise = strength * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return transition, noise


def _run_kalman_filter(
    values: np.ndarray, variance: np.ndarray, moves: list[tuple[np.ndarray, np.ndarray]]
) -> tuple[np.ndarray, np.ndarray]:
    """Run the Kalman filter: states (F, D, 2) and covariances (F, D, 2, 2) after each value."""
    n, n_dof = values.shape
    states, covariances = np.empty((n, n_dof, 2)), np.empty((n, n_dof, 2, 2))
    # The first velocity is nearly unknown: its variance covers any that the first two values allow.
    fast = moves[0][1][1, 1] + 1.0 / moves[0][0][0, 1] ** 2
    states[0] = np.stack([values[0], np.zeros(n_dof)], -1)
    covariances[0] = variance[0][:, None, None] * np.diag([1.0, 1e3 * fast])
    for i, (transition, noise) in enumerate(moves, start=1):
        state = states[i - 1] @ transition.T
        covariance = transition @ covariances[i - 1] @ transition.T + noise
        gain = covariance[:, :, 0] / (covariance[:, 0, 0] + variance[i])[:, None]
        states[i] = state + gain * (values[i] - state[:, 0])[:, None]
        covariances[i] = covariance - gain[:, :, None] * covariance[:, None, 0, :]
    return states, covariances


def _run_rts_smoother(
    states: np.ndarray, covariances: np.ndarray, moves: list[tuple[np.ndarray, np.ndarray]]
) -> np.ndarray:
    """Run the Rauch-Tung-Striebel smoother: states (F, D, 2) given all values up to the last."""
    out = states.copy()
    for i in range(len(moves) - 1, -1, -1):
        transition, noise = moves[i]
        predicted = transition @ covariances[i] @ transition.T + noise
        gain = covariances[i] @ transition.T @ np.linalg.inv(predicted)
        out[i] += np.einsum("dij,dj->di", gain, out[i + 1] - states[i] @ transition.T)
    return out

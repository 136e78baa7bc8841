"""Rigs grown camera by camera, for takes in which the tables of pairs do not tell the arrangement.

Somebody who stays in place tells tilts and heights badly, so that true angles cost as much in the
tables as wrong ones. Here each camera is tried at all angles and elevations around the person,
beside those that are placed already and adjusted, and every partial rig is adjusted before the next
camera. All that is taken from a camera alone is where it sees the person, and how large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.common.progress import Track, track_silently
from psfs.diagnostics.sights import PersonPlace, Sight, find_person
from psfs.self_calibration.adjustment import (
    FIRST,
    SECOND,
    Adjusted,
    PersonPoints,
    adjust_extremes,
    adjust_last,
    measure_last_misfit,
    measure_misfit,
    measure_turn,
)
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.upright import floor_axes

#: Angles around the person, and elevations over the person's horizon, rad, that are tried: an
#: error of half a step, 8 degrees, is adjusted.
_ANGLES = np.arange(0, 2 * np.pi, np.pi / 12)
_ELEVATIONS = np.arange(-0.1, 0.7, 0.14)
#: Turn up to which two rigs are the same, rad.
SAME_TURN = 0.14
#: Rounds in which a new camera alone is adjusted, places of it that are, per rig before it, and
#: rigs of as many cameras.
ROUNDS, _PLACES, _TRIED = 5, 12, 32
#: Rigs of two cameras that are kept, two fewer with each further one, but at least four.
_KEPT = 14
#: Most rigs of all cameras, and multiple of the best one's misfit up to which they are adjusted.
_GROWN, _WORSE = 3, 1.15


def grow_rigs(
    cameras: Sequence[Camera], lags: np.ndarray, points: PersonPoints, config: PersonConfig,
    track: Track = track_silently,
) -> list[tuple[CameraRig, np.ndarray]]:  # fmt: skip
    """Return rigs and lags (V,) frames that may be right, the best first.

    lags: (V,) frames, right to about a frame.
    """
    sights = [Sight.create(hulls) for hulls in points.hulls]
    start = PersonPlace(np.zeros(3), np.array([0, 0, 1.0]), config.stature)
    branches: list[tuple[tuple[Camera, ...], np.ndarray]] = [
        ((place_camera(cameras[0], sights[0], start, 0.0, elevation),), lags[:1])
        for elevation in _ELEVATIONS
    ]
    found: list[tuple[float, Adjusted]] = []
    for number in track(range(1, len(cameras)), len(cameras) - 1, "grown rigs"):
        seen, tried = points.select(range(number + 1)), []
        for placed, own in branches:
            person = start if number == 1 else find_person(placed, sights)
            tried += _add_camera(
                placed, np.append(own, lags[number]), cameras[number], sights[number], person,
                seen,
            )  # fmt: skip
        tried.sort(key=lambda of: of[0])
        wanted = max(4, _KEPT + 2 - 2 * number)
        rigs = [(rig, own) for _, rig, own in tried[:_TRIED]]
        found = _adjust_branches(rigs, seen, wanted)
        branches = [(own.rig.cameras, own.lags) for _, own in found]
    near = [own for misfit, own in found if misfit <= _WORSE * found[0][0]]
    return [(own.rig, own.lags) for own in near[:_GROWN]]


def place_camera(
    camera: Camera, sight: Sight, person: PersonPlace, angle: float, elevation: float
) -> Camera:
    """Return the camera at an angle around the person's up and an elevation over the horizon, rad,
    without roll, so that it sees the person where and as large as it does."""
    across, ahead = sight.direction[1], sight.direction[2]
    share = np.clip(np.sin(elevation) / np.hypot(across, ahead), -1, 1)
    axes = floor_axes(np.arctan2(across, ahead) - np.arcsin(share), 0.0)
    right, forward = (axes @ sight.direction)[:2]
    azimuth = angle + np.pi - np.arctan2(forward, right)
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])
    R = axes.T @ turn.T @ _level_axes(person.up)
    distance = person.stature / sight.size
    return replace(camera, R=R, t=distance * sight.direction - R @ person.middle)


def _level_axes(up: np.ndarray) -> np.ndarray:
    """Return axes (3, 3) whose last is up."""
    first = np.cross(np.array([0, 1.0, 0]), up)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first), up])


def _add_camera(
    placed: Sequence[Camera], lags: np.ndarray, camera: Camera, sight: Sight, person: PersonPlace,
    points: PersonPoints,
) -> list[tuple[float, tuple[Camera, ...], np.ndarray]]:  # fmt: skip
    """Return misfits, cameras and lags with the camera where it fits best."""

    costs = np.empty((len(_ANGLES), len(_ELEVATIONS)))
    for at in np.ndindex(*costs.shape):
        own = place_camera(camera, sight, person, _ANGLES[at[0]], _ELEVATIONS[at[1]])
        costs[at] = measure_last_misfit((*placed, own), lags, points, moving=True)
    wide = np.pad(np.pad(costs, ((1, 1), (0, 0)), mode="wrap"), ((0, 0), (1, 1)), mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(wide, (3, 3)).min(axis=(2, 3))
    rows, columns = np.nonzero(costs <= around)
    order = np.argsort(costs[rows, columns])[:_PLACES]
    found = []
    for row, column in zip(rows[order], columns[order], strict=True):
        own = place_camera(camera, sight, person, _ANGLES[row], _ELEVATIONS[column])
        adjusted = adjust_last((*placed, own), lags, points, ROUNDS)
        if adjusted is not None:
            found.append((measure_last_misfit(*adjusted, points), *adjusted))
    return found


def _adjust_branches(
    branches: Sequence[tuple[tuple[Camera, ...], np.ndarray]], points: PersonPoints, wanted: int
) -> list[tuple[float, Adjusted]]:  # fmt: skip
    """Return the misfits and the best different branches after adjustment, the best first."""
    kept = [(CameraRig(cameras), lags) for cameras, lags in branches]
    found: list[tuple[float, Adjusted]] = []
    for rounds in (FIRST, SECOND):
        tried = [adjust_extremes(rig, lags, points, rounds) for rig, lags in kept]
        found = [(measure_misfit(own, points, 1), own) for own in tried if own is not None]
        found = _keep_different(found, wanted)
        kept = [(own.rig, own.lags) for _, own in found]
    return found


def _keep_different(
    found: Sequence[tuple[float, Adjusted]], wanted: int
) -> list[tuple[float, Adjusted]]:
    """Return the best rigs, at most `wanted`, that differ by more than `SAME_TURN`, rad."""
    kept: list[tuple[float, Adjusted]] = []
    for misfit, best in sorted(found, key=lambda of: of[0]):
        cameras = best.rig.cameras
        if all(measure_turn(cameras, other.rig.cameras) > SAME_TURN for _, other in kept):
            kept.append((misfit, best))
        if len(kept) == wanted:
            break
    return kept

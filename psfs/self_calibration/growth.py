"""Rigs grown camera by camera, for takes in which the tables of pairs do not tell the arrangement.

Somebody who stays in place tells tilts and heights badly, so that true angles cost as much in the
tables as wrong ones. Here each camera is tried at all angles beside those that are placed already
and adjusted, and every partial rig is adjusted before the next camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.self_calibration.adjustment import (
    Adjusted,
    PersonPoints,
    adjust_extremes,
    measure_last_misfit,
    measure_misfit,
)
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.start import place_cameras
from psfs.self_calibration.upright import UprightView


@dataclass(frozen=True, eq=False)
class _Branch:
    """The first cameras of a rig, their lags (k,) frames, and the view of the very first."""

    cameras: tuple[Camera, ...]
    lags: np.ndarray
    view: UprightView


def grow_rigs(
    cameras: Sequence[Camera], views: Sequence[Sequence[UprightView]], lags: np.ndarray,
    points: PersonPoints, step: int, config: PersonConfig,
) -> list[tuple[CameraRig, np.ndarray]]:  # fmt: skip
    """Return rigs and lags (V,) frames that may be right, the best first.

    views: [camera][variant], of every `step`-th frame. lags: (V,) frames, roughly right.
    """
    branches = [
        _Branch(place_cameras(cameras[:1], [own], np.zeros(1), [0], config.stature).cameras,
                lags[:1], own)
        for own in views[0]
    ]  # fmt: skip
    for number in range(1, len(cameras)):
        seen = points.select(number + 1)
        tried = [
            found
            for branch in branches
            for found in _add_camera(
                branch, cameras[number], views[number], lags[number], seen, config, step=step
            )
        ]
        wanted = config.growth.kept[min(number, len(config.growth.kept)) - 1]
        branches = _adjust_branches(tried, seen, wanted, config)
    return [(CameraRig(own.cameras), own.lags) for own in branches[: config.growth.grown]]


def _add_camera(
    branch: _Branch, camera: Camera, views: Sequence[UprightView], lag: float,
    points: PersonPoints, config: PersonConfig, *, step: int,
) -> list[_Branch]:  # fmt: skip
    """Return the branch with the camera at the angles where it fits best."""
    lags = np.append(branch.lags, lag)
    n_angles, best = config.growth.angles, []
    for angle in 2 * np.pi * np.arange(n_angles) / n_angles:
        tried = []
        for view in views:
            pair = place_cameras(
                (branch.cameras[0], camera), (branch.view, view), np.array([0, angle]),
                (0, round(lag / step)), config.stature,
            )  # fmt: skip
            placed = (*branch.cameras, pair[1])
            tried.append((measure_last_misfit(placed, lags, points), placed))
        best.append(min(tried, key=lambda of: of[0]))
    misfits = np.array([misfit for misfit, _ in best])
    low = np.nonzero((misfits <= np.roll(misfits, 1)) & (misfits <= np.roll(misfits, -1)))[0]
    chosen = low[np.argsort(misfits[low])][: config.growth.places]
    return [_Branch(best[at][1], lags, branch.view) for at in chosen]


def _adjust_branches(
    branches: Sequence[_Branch], points: PersonPoints, wanted: int, config: PersonConfig
) -> list[_Branch]:
    """Return the best different branches after adjustment, the best first."""
    found: list[tuple[float, Adjusted, UprightView]] = []
    for own in branches:
        rig = CameraRig(own.cameras)
        adjusted = adjust_extremes(rig, own.lags, points, config.adjustment.second)
        if adjusted is not None:
            found.append((measure_misfit(adjusted, points, 1), adjusted, own.view))
    found.sort(key=lambda of: of[0])
    kept: list[_Branch] = []
    for _, best, view in found:
        cameras = best.rig.cameras
        if all(_turn_apart(cameras, other.cameras) > config.growth.same for other in kept):
            kept.append(_Branch(cameras, best.lags, view))
        if len(kept) == wanted:
            break
    return kept


def _turn_apart(first: Sequence[Camera], second: Sequence[Camera]) -> float:
    """Return the largest difference, rad, of the cameras' rotations against the first camera's."""
    one, other = (np.stack([c.R @ of[0].R.T for c in of[1:]]) for of in (first, second))
    cosines = 0.5 * (np.einsum("vij,vij->v", one, other) - 1)
    return float(np.arccos(np.clip(cosines, -1, 1)).max())

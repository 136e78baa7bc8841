"""Passes over a rig that was found: adjusted until it stays, its points matched again in each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import cv2
import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.diagnostics.refinement import correct_camera
from psfs.self_calibration.adjustment import (
    Adjusted,
    Bind,
    PersonPoints,
    adjust_rounds,
    measure_turn,
)
from psfs.self_calibration.limbs import LimbPoints
from psfs.self_calibration.sights import Sight, find_person


def adjust_farther(start: Adjusted, points: PersonPoints) -> Adjusted:
    """Adjust a rig that may be some degrees off to all frontier points until it stays.

    Points are matched again in every round, which moves such a rig by a small share of its error:
    each pass goes on by a multiple of the last step, and is kept if no fewer points agree then.
    """
    config, found, idle = points.config, start, 0
    for _ in range(config.passes):
        near = _adjust_to(config.near_gates, found, points) if idle < 2 else None
        if near is None:
            break
        if measure_turn(found.rig.cameras, near.rig.cameras) < config.settled:
            return near
        far = _adjust_to(config.far_gates, _go_on(found, near, config.farther), points)
        before = max(near.last.count, found.last.count)
        idle = 0 if far is not None and far.last.count > config.more * before else idle + 1
        found = near if far is None or far.last.count < config.fewer * before else far
    return found


def settle(
    start: Adjusted, points: PersonPoints, measure: Callable[[Adjusted], Bind] | None = None
) -> Adjusted:
    """Adjust a rig to all frontier points, matched again in every pass, until it stays.

    measure: makes further measurements of the rig of each pass.
    """
    config, found = points.config, start
    for _ in range(config.last):
        bind = None if measure is None else measure(found)
        near = _adjust_to(config.near_gates, found, points, bind)
        if near is None:
            break
        turn = measure_turn(found.rig.cameras, near.rig.cameras)
        found = near
        if turn < config.settled:
            break
    return found


def settle_by_limbs(start: Adjusted, points: PersonPoints) -> Adjusted:
    """Adjust a rig until it stays, then to points on limbs' axes, too."""
    axes = points.find_medial_axes()
    sights = [Sight.create(hulls) for hulls in points.hulls]

    def measure(found: Adjusted) -> Bind:
        cameras = found.rig.cameras
        person = find_person(cameras, sights)
        limbs = LimbPoints(cameras, found.lags, axes, person, points.config.limbs)
        return lambda shifts: (limbs.bind(shifts), partial(points.group, shifts=shifts))

    return settle(settle(start, points), points, measure)


def _adjust_to(
    gates: Sequence[float], start: Adjusted, points: PersonPoints, bind: Bind | None = None
) -> Adjusted | None:
    return adjust_rounds(start.rig, start.lags, points.find_all, points.config.narrow, gates, bind)


def _go_on(first: Adjusted, second: Adjusted, factor: float) -> Adjusted:
    """Return the second rig, moved on by `factor` times its difference from the first."""
    cameras = []
    for before, after in zip(first.rig, second.rig, strict=True):
        turn = cv2.Rodrigues(after.R @ before.R.T)[0].ravel()
        step = np.array([*turn, *(after.centre - before.centre), 0, 0])
        cameras.append(correct_camera(after, factor * step))
    lags = second.lags + factor * (second.lags - first.lags)
    return Adjusted(CameraRig(tuple(cameras)), lags, second.last)

"""Passes over a rig that was found: adjusted until it stays, its points matched again in each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import cv2
import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.diagnostics.frontier import FrontierPoints, SilhouetteContours
from psfs.diagnostics.limbs import LimbPoints, LimbViews
from psfs.diagnostics.refinement import N_PARAMETERS, Measure, correct_camera
from psfs.self_calibration.adjustment import (
    Adjusted,
    MeasureShifted,
    PersonPoints,
    adjust_rounds,
    measure_turn,
)
from psfs.self_calibration.room import RoomEdges


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
    start: Adjusted, points: PersonPoints,
    prepare: Callable[[Adjusted], MeasureShifted] | None = None,
) -> Adjusted:  # fmt: skip
    """Adjust a rig to all frontier points, matched again in every pass, until it stays.

    prepare: returns further measurements for the rig with which a pass begins.
    """
    config, found = points.config, start
    for _ in range(config.last):
        further = None if prepare is None else prepare(found)
        near = _adjust_to(config.near_gates, found, points, further)
        if near is None:
            break
        turn = measure_turn(found.rig.cameras, near.rig.cameras)
        found = near
        if turn < config.settled:
            break
    return found


def settle_finely(
    start: Adjusted, points: PersonPoints, find_edges: Callable[[CameraRig], RoomEdges | None]
) -> Adjusted:  # fmt: skip
    """Adjust a rig to frontier points and the room's edges until it stays, then to points on limbs'
    axes, too. find_edges: returns the edges' measurements of a rig, if they are clear."""
    views = LimbViews.create(points.hulls, points.contours, points.config.limbs)
    waists = [_find_waists(contours) for contours in points.contours]

    def prepare(found: Adjusted, limbs: LimbPoints | None = None) -> MeasureShifted:
        room = find_edges(found.rig)

        def measure(shifts: np.ndarray) -> tuple[Measure, Callable[[FrontierPoints], np.ndarray]]:
            further: list[Measure] = [] if room is None else [room]
            further += [] if limbs is None else [limbs.bind(shifts)]
            return partial(_add_up, further), partial(_group, waists=waists, shifts=shifts)

        return measure

    def prepare_limbs(found: Adjusted) -> MeasureShifted:
        return prepare(found, views.find_points(found.rig.cameras, found.lags))

    return settle(settle(start, points, prepare), points, prepare_limbs)


def _add_up(
    further: Sequence[Measure], cameras: Sequence[Camera], offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the normal matrix and the gradient of several measurements."""
    size = len(cameras) * N_PARAMETERS
    normal, gradient = np.zeros((size, size)), np.zeros(size)
    for measure in further:
        more, pull = measure(cameras, offsets)
        normal, gradient = normal + more, gradient + pull
    return normal, gradient


def _find_waists(contours: SilhouetteContours) -> np.ndarray:
    """Return the rows (F,) px halfway between top and bottom of the contours."""
    low, high = np.full((2, int(contours.frames.max(initial=-1)) + 1), np.nan)
    np.fmin.at(low, contours.frames, contours.points[:, 1])
    np.fmax.at(high, contours.frames, contours.points[:, 1])
    return 0.5 * (low + high)


def _group(found: FrontierPoints, waists: Sequence[np.ndarray], shifts: np.ndarray) -> np.ndarray:
    """Return numbers (M,) of frontier points of shifted frames: apart by pair of cameras, and the
    person's upper and lower half, for shadows of the floor spoil the feet."""
    first, second = found.views.T
    low = np.zeros(len(found), int)
    for view, rows in enumerate(waists):
        mine = first == view
        low[mine] = found.pixels[mine, 0, 1] > rows[found.frames[mine] + int(shifts[view])]
    return 2 * (first * len(waists) + second) + low


def _adjust_to(
    gates: Sequence[float], start: Adjusted, points: PersonPoints,
    further: MeasureShifted | None = None,
) -> Adjusted | None:  # fmt: skip
    narrow = points.config.narrow
    return adjust_rounds(start.rig, start.lags, points.find_all, narrow, gates, further)


def _go_on(first: Adjusted, second: Adjusted, factor: float) -> Adjusted:
    """Return the second rig, moved on by `factor` times its difference from the first."""
    cameras = []
    for before, after in zip(first.rig, second.rig, strict=True):
        turn = cv2.Rodrigues(after.R @ before.R.T)[0].ravel()
        step = np.array([*turn, *(after.centre - before.centre), 0, 0])
        cameras.append(correct_camera(after, factor * step))
    lags = second.lags + factor * (second.lags - first.lags)
    return Adjusted(CameraRig(tuple(cameras)), lags, second.last)

"""Cameras of a large rig, added to some of them that are already found.

The tables of all pairs of many cameras, and the adjustment of all of them for each arrangement that
may be right, would grow with the square of their number. With the core found, the person's places
and the core's tilts and heights are known, so each further camera is placed by tables with a few of
the core's cameras, and adjusted alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cl import InputError
from psfs.cameras.camera import Camera
from psfs.self_calibration.adjustment import LAST_GATE, Adjusted, adjust_last, measure_last_misfit
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.growth import ROUNDS
from psfs.self_calibration.head_height import compare_head_heights
from psfs.self_calibration.pairing import Walker, compare_pair
from psfs.self_calibration.search import N_ANGLES, ArrangementSearch
from psfs.self_calibration.take import FILM, Outlines, PersonTake
from psfs.self_calibration.upright import UprightView, view_from_up
from psfs.self_calibration.world import align_to_person, measure_places

#: Most cameras that are searched together, and number of these with which another is compared.
CORE, _ANCHORS = 8, 4


def choose_core(outlines: Outlines, count: int = CORE) -> list[int]:
    """Return the `count` cameras that see the whole person in most pictures, in their order."""
    whole = [sum(of is not None and not of.at_border.any() for of in own) for own in outlines]
    return sorted(np.argsort(np.negative(whole), kind="stable")[:count].tolist())


class CameraAddition:
    """Places further cameras beside those of a rig that was found.

    core: the cameras of the rig among all cameras of the take.
    """

    def __init__(
        self, found: Adjusted, core: Sequence[int], take: PersonTake, config: PersonConfig
    ) -> None:
        self.core, self.take, self.config = core, take, config
        own = take.select(core)
        shifts = np.round(found.lags).astype(int)
        touched = own.points.find_all(found.rig.cameras, shifts, LAST_GATE)
        (self.rig, _), self.lags = align_to_person(found, own, touched, config), found.lags
        self._frames, self._places = measure_places(self.rig, touched)
        self._walkers, self._azimuths = [], []
        self._hulls = take.trace_hulls()
        for view, camera in list(zip(core, self.rig, strict=True))[:_ANCHORS]:
            seen = take.outlines[view][:: take.step]
            upright = view_from_up(camera, seen, camera.R[:, 2])
            upright = replace(upright, height=camera.centre[2] / config.stature)
            self._walkers.append(Walker.create(upright, self._hulls[view]))
            right = camera.R.T @ upright.axes[0]
            self._azimuths.append(float(np.arctan2(right[1], right[0])))

    def add(self, view: int) -> tuple[Camera, float]:
        """Return a further camera and its lag, frames. Raises InputError if it fits nowhere."""
        points = self.take.points.select([*self.core, view])
        found = []
        for camera, lag in self._find_starts(view):
            lags = np.append(self.lags, lag)
            cameras = (*self.rig.cameras, camera)
            adjusted = adjust_last(cameras, lags, points, ROUNDS)
            if adjusted is not None:
                found.append((measure_last_misfit(*adjusted, points), *adjusted))
        if not found:
            raise InputError(
                f"{self.take.cameras[view].name} fits nowhere beside the other cameras; {FILM}"
            )
        _, cameras, lags = min(found, key=lambda of: of[0])
        return cameras[-1], float(lags[-1])

    def _find_starts(self, view: int) -> list[tuple[Camera, float]]:
        """Return where the camera may be, and its lags, frames, the best first."""
        take = self.take
        angles = 2 * np.pi * np.arange(N_ANGLES) / N_ANGLES
        variants = [Walker.create(own, self._hulls[view]) for own in take.views[view]]
        tables, last, steps = {}, len(self._walkers), np.round(self.lags / take.step).astype(int)
        for k, (walker, azimuth) in enumerate(zip(self._walkers, self._azimuths, strict=True)):
            costs = [compare_pair(walker, own, angles - azimuth, take.most) for own in variants]
            heights = take.heights[self.core[k]], take.heights[view]
            common = compare_head_heights(*heights, take.most, take.step)
            tables[k, last] = np.array(costs)[None] + common
        search = ArrangementSearch(tables, last + 1)
        placed = {k: (0, 0, int(steps[k])) for k in range(last)}
        return [
            self._place(view, take.views[view][variant], angles[angle], lag)
            for _, (variant, angle, lag) in search.best_places(last, placed)
        ]

    def _place(
        self, view: int, upright: UprightView, angle: float, lag: int
    ) -> tuple[Camera, float]:
        """Return the camera at an angle, rad, and lag, steps, where it sees the person as the core
        does."""
        step, stature = self.take.step, self.config.stature
        cosine, sine = np.cos(angle), np.sin(angle)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        there = stature * upright.places @ turn.T
        frames = step * (np.arange(len(there)) - lag)
        _, here, own = np.intersect1d(self._frames, frames, return_indices=True)
        apart = self._places[here] - there[own]
        shift = np.nanmedian(apart, axis=0) if np.isfinite(apart).any() else np.zeros(2)
        world = np.eye(3)
        world[:2, :2] = turn
        R = upright.axes.T @ world.T
        centre = np.array([*shift, stature * upright.height])
        return replace(self.take.cameras[view], R=R, t=-R @ centre), float(step * lag)

"""Adjustment of all cameras and their times to the silhouettes of one person.

Robust least squares over epipolar residuals (see `psfs.diagnostics.refinement`): first of the
outermost planes that touch the silhouettes, which need no matching and so bear errors of many
degrees and frames, then of all frontier points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import cv2
import numpy as np

from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.rig_geometry import intersect_axes_ahead, look_along_baseline
from psfs.diagnostics.frontier import (
    NEAREST,
    FrontierPoints,
    SilhouetteContours,
    epipolar_residuals,
    find_frontier_points,
    join_points,
)
from psfs.diagnostics.hulls import HullRays
from psfs.diagnostics.refinement import Further, RigCorrections, correct_camera, fit_rig
from psfs.diagnostics.small_views import Outline
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.upright import FEWEST

#: Distance of a point from its epipolar line beyond which it is no worse, px.
FARTHEST = 8.0
#: Rounds of the first adjustment and of the finalists'.
FIRST, SECOND = 4, 10
#: Gates of the outermost planes and of the last rounds, px: so far silhouettes are wrong.
_GATE, LAST_GATE = 4.0, 2.0
#: Turn, rad, and lag, frames, up to which two rigs are the same arrangement.
_SAME_TURN, _SAME_LAG = 0.14, 4.0
#: Most passes over a rig, the share of a standard deviation below which it stays, and the multiple
#: of a step by which another goes on.
_PASSES, _SETTLED, _FURTHER = 8, 0.1, 5.0
#: Find the points of `fit_rig` for shifts (V,) of cameras' frames.
FindShifted = Callable[[np.ndarray, Sequence[Camera], float, np.ndarray], FrontierPoints]
#: Return `further` of `fit_rig` for shifts (V,) of cameras' frames.
MeasureShifted = Callable[[np.ndarray], Sequence[Further]]


@dataclass(frozen=True, eq=False)
class Adjusted:
    """An adjusted rig. lags: (V,) frame t of the first camera shows the time of frame t + lags[v]
    of camera v. last: the corrections of the last step."""

    rig: CameraRig
    lags: np.ndarray
    last: RigCorrections

    @property
    def shifts(self) -> np.ndarray:
        """The lags (V,) in whole frames."""
        return np.round(self.lags).astype(int)


class PersonPoints:
    """The tangent points of the person's silhouettes [view][frame] of small `cameras`."""

    def __init__(
        self, cameras: Sequence[Camera], outlines: Sequence[Sequence[Outline | None]],
        config: PersonConfig,
    ) -> None:  # fmt: skip
        self.config = config
        #: Steps of the cameras; lenses are kept unless only an angle of view is stated.
        self.spread = np.array([*3 * [0.1], *3 * [0.3], 0.3 * config.focal, 5.0])
        self.hulls = [HullRays(c, lines) for c, lines in zip(cameras, outlines, strict=True)]
        self.contours = [SilhouetteContours(lines) for lines in outlines]
        self._waists = [_find_waists(contours) for contours in self.contours]
        self.counts = [len(lines) for lines in outlines]
        self.shortest = min(self.counts)
        #: In how many pictures each camera shows the whole person.
        self.whole = [sum(o is not None and not o.at_border.any() for o in r) for r in outlines]

    def select(self, views: Sequence[int]) -> PersonPoints:
        """Return those of some cameras."""
        chosen = copy(self)
        chosen.hulls = [self.hulls[view] for view in views]
        chosen.contours = [self.contours[view] for view in views]
        chosen._waists = [self._waists[view] for view in views]
        return chosen

    def find_extremes(
        self, cameras: Sequence[Camera], shifts: np.ndarray, every: int = 1
    ) -> FrontierPoints:
        """Return the points in which the outermost planes touch both silhouettes, of every
        `every`-th frame."""
        scene, pair_points = intersect_axes_ahead(CameraRig(tuple(cameras))), []
        for pair in combinations(range(len(cameras)), 2):
            _, axes, distance = look_along_baseline(cameras[pair[0]], cameras[pair[1]], scene)
            if distance < NEAREST:
                continue
            sides = []
            for view in pair:
                x, y = (self.hulls[view].rays @ (cameras[view].R @ axes)).T
                extremes = self.hulls[view].extreme_points(np.arctan2(y, x))
                sides.append((*extremes, int(shifts[view])))
            pair_points.append(_match_extremes(pair, sides[0], sides[1], every))
        return join_points(pair_points)

    def find_all(
        self,
        shifts: np.ndarray,
        cameras: Sequence[Camera],
        gate: float,
        _: np.ndarray | None = None,
    ) -> FrontierPoints:
        """Return the outermost points and the tips of contours that agree to `gate` px, in the
        cameras' pictures of shifted frames: a `Find` of `fit_rig` for these shifts."""
        outermost = self.find_extremes(cameras, shifts)
        residuals, _ = epipolar_residuals(cameras, outermost, np.zeros(len(cameras)))
        fitting = np.abs(residuals) < gate
        moved = []
        for contours, shift in zip(self.contours, shifts, strict=True):
            view_contours = copy(contours)
            view_contours.frames = contours.frames - int(shift)
            moved.append(view_contours)
        scene = intersect_axes_ahead(CameraRig(tuple(cameras)))
        tips = find_frontier_points(cameras, moved, scene, gate)
        return join_points([outermost.select(fitting), tips])

    def group(self, points: FrontierPoints, shifts: np.ndarray) -> np.ndarray:
        """Return numbers (M,) of frontier points of shifted frames: apart by pair of cameras, and
        the person's upper and lower half, for shadows of the floor spoil the feet."""
        first, second = points.views.T
        low = np.zeros(len(points), int)
        for view, rows in enumerate(self._waists):
            mine = first == view
            low[mine] = points.pixels[mine, 0, 1] > rows[points.frames[mine] + int(shifts[view])]
        return 2 * (first * len(self._waists) + second) + low


def _find_waists(contours: SilhouetteContours) -> np.ndarray:
    """Return the rows (F,) px halfway between top and bottom of the contours."""
    low, high = np.full((2, int(contours.frames.max(initial=-1)) + 1), np.nan)
    np.fmin.at(low, contours.frames, contours.points[:, 1])
    np.fmax.at(high, contours.frames, contours.points[:, 1])
    return 0.5 * (low + high)


def _match_extremes(
    pair: tuple[int, int],
    first: tuple[np.ndarray, np.ndarray, int],
    second: tuple[np.ndarray, np.ndarray, int],
    every: int,
) -> FrontierPoints:
    """Return the points of two cameras whose angles and pixels [frame][side] and shifts are
    given."""
    begin = max(-first[2], -second[2])
    end = min(len(first[0]) - first[2], len(second[0]) - second[2])
    if end - begin < 3:
        return join_points([])
    angles = [side[0][begin + side[2] : end + side[2]] for side in (first, second)]
    pixels = [side[1][begin + side[2] : end + side[2]][1:-1] for side in (first, second)]
    rates = 0.25 * np.sum([side[2:] - side[:-2] for side in angles], axis=0)
    known = np.isfinite(rates) & np.isfinite(angles[0][1:-1]) & np.isfinite(angles[1][1:-1])
    known[(np.arange(len(known)) + begin) % every != 0] = False
    frames, sides = np.nonzero(known)
    both = np.stack([side[frames, sides] for side in pixels], 1)
    views = np.tile(pair, (len(frames), 1))
    return FrontierPoints(views, frames + begin + 1, both, rates[frames, sides])


def adjust_extremes(
    rig: CameraRig, lags: np.ndarray, points: PersonPoints, rounds: int, every: int = 1
) -> Adjusted | None:
    """Adjust the rig to the outermost planes; None if there are too few."""
    return adjust_rounds(
        rig, lags, points, [_GATE] * rounds,
        lambda shifts, cameras, gate, _: points.find_extremes(cameras, shifts, every),
    )  # fmt: skip


def adjust_frontier(
    start: Adjusted, points: PersonPoints, widest: float = 16.0,
    further: MeasureShifted | None = None,
) -> Adjusted | None:  # fmt: skip
    """Adjust the rig to all frontier points, matched again within gates from the `widest`, px, to
    the last; None if there are too few."""
    gates = np.geomspace(widest, LAST_GATE, round(widest / 2))
    return adjust_rounds(start.rig, start.lags, points, list(gates), points.find_all, further)


def measure_turn(first: Sequence[Camera], second: Sequence[Camera]) -> float:
    """Return the largest difference, rad, of the cameras' rotations against the first camera's."""
    one, other = (np.stack([c.R @ rig[0].R.T for c in rig[1:]]) for rig in (first, second))
    cosines = 0.5 * (np.einsum("vij,vij->v", one, other) - 1)
    return float(np.arccos(np.clip(cosines, -1, 1)).max())


def differ(first: Adjusted, second: Adjusted) -> bool:
    """Return whether two rigs are different arrangements: farther apart than the search's steps."""
    turn = measure_turn(first.rig.cameras, second.rig.cameras)
    return turn > _SAME_TURN or float(np.abs(first.lags - second.lags).max()) > _SAME_LAG


def adjust_rounds(
    rig: CameraRig, lags: np.ndarray, person: PersonPoints, gates: Sequence[float],
    find: FindShifted, further: MeasureShifted | None = None,
) -> Adjusted | None:  # fmt: skip
    """Adjust the rig to what `find` finds, in a round per gate; None if there are too few points.

    further: further measurements; with these the noise of the person's parts is estimated apart.
    """
    corrections = None
    for gate in gates:
        shifts = np.round(lags).astype(int)
        more = () if further is None else further(shifts)
        group = None if further is None else partial(person.group, shifts=shifts)
        start = np.zeros((len(rig), 8))
        start[:, 7] = shifts - lags
        # Cameras without common points have no variances; they are refused later.
        with np.errstate(all="ignore"):
            try:
                corrections = fit_rig(
                    rig, [gate], partial(find, shifts), person.spread, start, more, group
                )
                if corrections is None:
                    return None
                rig, lags = corrections.apply(rig), shifts - corrections.offsets
            except InputError:  # cameras that cannot be: the steps diverge
                return None
        lags = lags - lags[0]
    return None if corrections is None else Adjusted(rig, lags, corrections)


def measure_misfit(adjusted: Adjusted, points: PersonPoints, every: int = 1) -> float:
    """Return the mean distance, px, of the outermost points from the epipolar lines. Each point
    that is missing, because lags leave out its frame, counts with half the largest distance."""
    outermost, residuals = _measure_extremes(adjusted, points, every)
    n = len(adjusted.rig)
    wanted = 0.5 * n * (n - 1) * points.shortest / every
    total = np.minimum(np.abs(residuals), FARTHEST).sum()
    total += 0.5 * FARTHEST * max(0.0, wanted - len(outermost))
    return float(total / max(wanted, len(outermost), 1))


def _measure_extremes(
    adjusted: Adjusted, points: PersonPoints, every: int = 1
) -> tuple[FrontierPoints, np.ndarray]:
    """Return the outermost points and their residuals (M,), px."""
    cameras, shifts = adjusted.rig.cameras, adjusted.shifts
    outermost = points.find_extremes(cameras, shifts, every)
    return outermost, epipolar_residuals(cameras, outermost, shifts - adjusted.lags)[0]


def measure_misfits(adjusted: Adjusted, points: PersonPoints) -> np.ndarray:
    """Return by how much the silhouettes of each camera (V,) differ from those of the others, px.

    Of every two cameras that is the median distance of their outermost points from the epipolar
    lines, of all of them, whether they agree or not, and of a camera the median of its pairs, which
    a shadow that two cameras see alike does not move. Infinity with fewer than two pairs that share
    enough: one alone does not tell how far away a camera is.
    """
    outermost, residuals = _measure_extremes(adjusted, points)
    of_cameras: list[list[float]] = [[] for _ in adjusted.rig]
    for pair in combinations(range(len(of_cameras)), 2):
        errors = np.abs(residuals[(outermost.views == pair).all(axis=1)])
        if len(errors) >= FEWEST:
            for view in pair:
                of_cameras[view].append(float(np.median(errors)))
    return np.array([np.median(of) if len(of) >= 2 else np.inf for of in of_cameras])


def refine_until_converged(
    start: Adjusted, points: PersonPoints,
    prepare: Callable[[Adjusted], MeasureShifted] | None = None, far: bool = False,
) -> Adjusted:  # fmt: skip
    """Adjust a rig to all frontier points, matched again in every pass, until it stays.

    prepare: returns further measurements for the rig with which a pass begins. far: the rig may be
    some degrees off. Matching again moves such a rig by a small share of its error: each pass goes
    on by a multiple of the last step (over-relaxation) and is kept if more points agree then.
    """
    before = start
    for _ in range(_PASSES):
        after = adjust_frontier(before, points, 4.0, None if prepare is None else prepare(before))
        if after is None:
            break
        turn = measure_turn(before.rig.cameras, after.rig.cameras)
        if turn < _SETTLED * after.last.sigmas[:, :3].min():
            return after
        ahead = adjust_frontier(_go_on(before, after), points, 8.0) if far else None
        before = after
        if ahead is not None and ahead.last.count > after.last.count:
            before = ahead
    return before


def _go_on(first: Adjusted, second: Adjusted) -> Adjusted:
    """Return the second rig, moved on by a multiple of its difference from the first."""
    cameras = []
    for before, after in zip(first.rig, second.rig, strict=True):
        turn = cv2.Rodrigues(after.R @ before.R.T)[0].ravel()
        step = np.array([*turn, *(after.centre - before.centre), 0, 0])
        cameras.append(correct_camera(after, _FURTHER * step))
    lags = second.lags + _FURTHER * (second.lags - first.lags)
    return Adjusted(CameraRig(tuple(cameras)), lags, second.last)

"""Cameras, times and floor from the silhouettes of somebody who walks about.

Each camera tells its tilt and height, and the person's places, by itself (`upright`); angles and
lags are searched in tables of all pairs (`pairing`, `bobbing`, `search`); the best arrangements are
adjusted, and the best of these is adjusted to all frontier points (`adjustment`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.names import join_names
from psfs.cameras.rig_geometry import intersect_axes_ahead
from psfs.diagnostics.frontier import FrontierPoints
from psfs.diagnostics.small_views import Outline
from psfs.self_calibration.adjustment import (
    Adjusted,
    PersonPoints,
    adjust_extremes,
    adjust_frontier,
    measure_misfit,
    measure_misfits,
)
from psfs.self_calibration.bobbing import compare_bobbing, measure_bobbing
from psfs.self_calibration.config import AdjustmentConfig, PersonConfig
from psfs.self_calibration.hulls import HullRays
from psfs.self_calibration.pairing import Walker, compare_pair
from psfs.self_calibration.search import ArrangementSearch
from psfs.self_calibration.start import place_cameras, reverse_rig
from psfs.self_calibration.upright import UprightView, fit_upright
from psfs.self_calibration.world import align_to_person, measure_path

Outlines = Sequence[Sequence[Outline | None]]
#: Return outlines [view][frame] by a rig and lags (V,).
Extract = Callable[[CameraRig, np.ndarray], Outlines]
#: What to film if the cameras cannot be found.
FILM = (
    "film one person who walks about for ten seconds or more, towards and past all cameras, wholly "
    "seen by all of them, with a second of the empty room in background/"
)


@dataclass(frozen=True, eq=False)
class PersonCalibration:
    """Cameras found from a person.

    rig: small cameras, metres, Z up. lags: (V,) frames: frame t of the first camera shows the time
    of frame t + lags[v] of camera v. residual: median distance of the frontier points that agree
    from the epipolar lines, px. count: of these points. misfits: (V,) px, see `measure_misfits`.
    path: standard deviation of the person's places along the main direction of the walk, m.

    Standard deviations are not stated: silhouettes are wrong alike in neighbouring frames, so those
    of the least squares are several times too small.
    """

    rig: CameraRig
    lags: np.ndarray
    residual: float
    count: int
    misfits: np.ndarray
    path: float


def calibrate_by_person(
    cameras: Sequence[Camera], outlines: Outlines, rate: float, config: PersonConfig,
    extract: Extract | None = None,
) -> PersonCalibration:  # fmt: skip
    """Estimate the cameras' poses and lags from outlines [view][frame] at `rate` per second.

    cameras: small, with the intrinsics that are kept. extract: returns better outlines, without
    shadows on the floor, once a rig, metres, Z = 0 on the floor, and lags (V,) are known. Raises
    InputError, which says what to film, if the cameras cannot be found.
    """
    if len(cameras) < 3:
        raise InputError(
            f"{len(cameras)} cameras; expected three or more, for two cameras' silhouettes do not "
            "tell their arrangement"
        )
    _check_seen(cameras, outlines, config)
    failures = []
    for in_place in (False, True):
        views = _fit_views(cameras, outlines, rate, config, in_place)
        try:
            return _calibrate(cameras, outlines, views, rate, config, extract)
        except InputError as error:
            failures.append(error)
    raise failures[0]


def _fit_views(
    cameras: Sequence[Camera], outlines: Outlines, rate: float, config: PersonConfig, in_place: bool
) -> list[list[UprightView]]:
    step = max(1, round(rate / config.table_rate))
    views = [
        fit_upright(c, own[::step], config.upright, in_place)
        for c, own in zip(cameras, outlines, strict=True)
    ]
    if any(own is None for own in views):
        unseen = [c.name for c, own in zip(cameras, views, strict=True) if own is None]
        raise InputError(f"{join_names(unseen)}: the person is seldom seen wholly; {FILM}")
    return [own for own in views if own is not None]


def _calibrate(
    cameras: Sequence[Camera], outlines: Outlines, views: list[list[UprightView]], rate: float,
    config: PersonConfig, extract: Extract | None,
) -> PersonCalibration:  # fmt: skip
    """Estimate the cameras from what each of them tells of its tilt and height."""
    step = max(1, round(rate / config.table_rate))
    points = PersonPoints(cameras, outlines, config.adjustment)
    best = _adjust_best(_search(cameras, outlines, views, rate, config), points, step, config)
    if best is None:
        raise InputError(f"no arrangement of the cameras fits the silhouettes; {FILM}")
    ups = [own[0].axes[2] for own in views]
    if extract is not None:
        _check_misfits(best, points, config.first_residual)
        world = align_to_person(best.rig, ups, _find_touched(best, points, config), config)
        points = PersonPoints(cameras, extract(world, best.lags), config.adjustment)
        best = _adjust_again(Adjusted(world, best.lags, best.last), points, config.adjustment)
    return _check(best, ups, points, config)


def _check_seen(cameras: Sequence[Camera], outlines: Outlines, config: PersonConfig) -> None:
    for camera, own in zip(cameras, outlines, strict=True):
        seen = sum(of is not None and not of.at_border.any() for of in own)
        if seen < config.least_frames:
            raise InputError(
                f"{camera.name}: the whole person is in {seen} of {len(own)} pictures; expected "
                f"{config.least_frames} or more; {FILM}"
            )


def _search(
    cameras: Sequence[Camera], outlines: Outlines, views: list[list[UprightView]], rate: float,
    config: PersonConfig,
) -> list[tuple[CameraRig, np.ndarray]]:  # fmt: skip
    """Return rigs and lags (V,) frames that may be right, the best first."""
    step = max(1, round(rate / config.table_rate))
    most = int(np.ceil(config.longest_lag * rate / step))
    hulls = [HullRays(c, own[::step]) for c, own in zip(cameras, outlines, strict=True)]
    walkers = [[Walker.create(v, h) for v in own] for own, h in zip(views, hulls, strict=True)]
    bobbing = [
        measure_bobbing(HullRays(c, own), view[0], rate, config.pairs)
        for c, own, view in zip(cameras, outlines, views, strict=True)
    ]
    angles = 2 * np.pi * np.arange(config.angles) / config.angles
    tables = {}
    for a, b in combinations(range(len(cameras)), 2):
        pair = [
            [compare_pair(x, y, angles, most, config.pairs) for y in walkers[b]] for x in walkers[a]
        ]
        tables[a, b] = np.array(pair) + compare_bobbing(
            bobbing[a], bobbing[b], most, step, config.pairs
        )
    found = []
    for arrangement in ArrangementSearch(tables, len(cameras), config.search).find(
        config.candidates
    ):
        chosen = [own[variant] for own, variant in zip(views, arrangement.variants, strict=True)]
        turned = angles[list(arrangement.angles)]
        rig = place_cameras(cameras, chosen, turned, arrangement.lags, config.stature)
        found.append((rig, step * np.array(arrangement.lags, float)))
    return found


def _adjust_best(
    starts: list[tuple[CameraRig, np.ndarray]], points: PersonPoints, step: int,
    config: PersonConfig,
) -> Adjusted | None:  # fmt: skip
    """Return the start that fits best after adjustment.

    A silhouette and its mirror image from the other side look alike from afar, so that the rigs
    that see the mirror image are tried as well.
    """
    own = config.adjustment
    first = [adjust_extremes(rig, lags, points, own.first, step) for rig, lags in starts]
    best = _sort_by_misfit(first, points, step, own.far)[: config.finalists]
    pairs = [(of.rig, of.lags) for of in best]
    pairs += [(reverse_rig(rig, intersect_axes_ahead(rig)), lags) for rig, lags in pairs]
    second = [adjust_extremes(rig, lags, points, own.second, step) for rig, lags in pairs]
    best = _sort_by_misfit(second, points, step, own.far)[: config.finalists]
    third = [adjust_frontier(of.rig, of.lags, points, own.gates) for of in best]
    for found in _sort_by_misfit(third, points, step, own.near)[:1]:
        return _adjust_again(found, points, own)
    return None


def _adjust_again(found: Adjusted, points: PersonPoints, config: AdjustmentConfig) -> Adjusted:
    """Adjust a rig that is nearly right to the frontier points several times."""
    for _ in range(config.repeated):
        found = adjust_frontier(found.rig, found.lags, points, config.gates[2:]) or found
    return found


def _find_touched(best: Adjusted, points: PersonPoints, config: PersonConfig) -> FrontierPoints:
    """Return the frontier points that agree."""
    shifts = np.round(best.lags).astype(int)
    return points.find_all(best.rig.cameras, shifts, config.adjustment.gates[-1])


def _sort_by_misfit(
    found: Sequence[Adjusted | None], points: PersonPoints, step: int, cap: float
) -> list[Adjusted]:
    known = [of for of in found if of is not None]
    return sorted(known, key=lambda of: measure_misfit(of, points, step, cap))


def _check_misfits(best: Adjusted, points: PersonPoints, most: float) -> np.ndarray:
    """Return the misfits (V,) of the cameras, see `measure_misfits`. Raises InputError if they are
    greater than `most`, px."""
    rig = best.rig
    misfits = measure_misfits(best, points)
    worst = int(np.argmax(misfits))
    if not np.isfinite(misfits[worst]):
        raise InputError(
            f"{rig[worst].name} shares too few pictures of the whole person with the other "
            f"cameras; {FILM}"
        )
    if misfits[worst] > most:
        raise InputError(
            f"the silhouettes fit no arrangement of the cameras: those of {rig[worst].name} and "
            f"another camera differ by {misfits[worst]:.2f} px, expected at most "
            f"{most:g}; {FILM}"
        )
    return misfits


def _check(
    best: Adjusted, ups: list[np.ndarray], points: PersonPoints, config: PersonConfig
) -> PersonCalibration:
    """Return the calibration in its world. Raises InputError if it cannot be trusted."""
    misfits = _check_misfits(best, points, config.worst_residual)
    touched = _find_touched(best, points, config)
    world = align_to_person(best.rig, ups, touched, config)
    path = measure_path(world, touched)
    if path < config.least_path * config.stature:
        raise InputError(
            f"the person walks too little: the places' standard deviation is {path:.2f} m, "
            f"expected {config.least_path * config.stature:.2f} or more; {FILM}"
        )
    last = best.last
    return PersonCalibration(world, best.lags, last.residual, last.count, misfits, path)

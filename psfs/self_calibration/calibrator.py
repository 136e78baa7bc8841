"""Cameras, times and floor from the silhouettes of somebody who walks about.

Each camera tells its tilt and height, and the person's places, by itself (`upright`); angles and
lags are searched in tables of all pairs (`pairing`, `bobbing`, `search`); the best arrangements are
adjusted, and the best of these is adjusted to all frontier points (`adjustment`). If none fits, as
of somebody who stays in place, the rig is grown camera by camera (`growth`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.names import join_names
from psfs.diagnostics.frontier import FrontierPoints
from psfs.diagnostics.small_views import Outline
from psfs.self_calibration.adjustment import (
    Adjusted,
    PersonPoints,
    adjust_extremes,
    adjust_farther,
    adjust_frontier,
    measure_misfit,
    measure_pairs,
    summarise_pairs,
)
from psfs.self_calibration.bobbing import compare_bobbing, measure_bobbing, refine_lags
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.growth import grow_rigs
from psfs.self_calibration.hulls import HullRays
from psfs.self_calibration.pairing import Walker, compare_pair
from psfs.self_calibration.search import ArrangementSearch
from psfs.self_calibration.start import place_cameras
from psfs.self_calibration.upright import UprightView, fit_upright
from psfs.self_calibration.world import align_to_person, measure_path

Outlines = Sequence[Sequence[Outline | None]]
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
    from the epipolar lines, px. count: of these points. misfits: (V,) px, see `summarise_pairs`.
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
    cameras: Sequence[Camera], outlines: Outlines, rate: float, config: PersonConfig
) -> PersonCalibration:
    """Estimate the cameras' poses and lags from outlines [view][frame] at `rate` per second.

    cameras: small, with the intrinsics that are kept. Raises InputError, which says what to film,
    if they cannot be found.
    """
    if len(cameras) < 3:
        raise InputError(
            f"{len(cameras)} cameras; expected three or more, for two cameras' silhouettes do not "
            "tell their arrangement"
        )
    _check_seen(cameras, outlines, config)
    step = max(1, round(rate / config.table_rate))
    points = PersonPoints(cameras, outlines, config.adjustment)
    views = _fit_views(cameras, outlines, step, config)
    bobbing = [
        measure_bobbing(hulls, own[0], rate, config.pairs)
        for hulls, own in zip(points.hulls, views, strict=True)
    ]
    most = int(np.ceil(config.longest_lag * rate / step))
    starts = _search(cameras, outlines, views, bobbing, (most, step), config)
    best = _adjust_best(starts, points, step, config)
    if starts and not _is_sure(best, points, config):
        lags = refine_lags(bobbing, starts[0][1], step, config.pairs)
        best = _adjust_grown(best, grow_rigs(cameras, lags, points, config), points)
    return _check(best, [own[0].axes[2] for own in views], points, config)


def adjust_calibration(
    start: CameraRig, lags: np.ndarray, outlines: Outlines, rate: float, config: PersonConfig
) -> PersonCalibration:
    """Adjust small cameras in metres with Z up, and their lags, to outlines [view][frame] at `rate`
    per second. What silhouettes do not tell, world and scale, stays as given. Raises InputError
    if the silhouettes do not fit."""
    _check_seen(start.cameras, outlines, config)
    points = PersonPoints(start.cameras, outlines, config.adjustment)
    best = _adjust_best([(start, lags)], points, max(1, round(rate / config.table_rate)), config)
    best, misfits, touched = _check_fit(best, points, config)
    last, path = best.last, measure_path(best.rig, touched)
    return PersonCalibration(best.rig, best.lags, last.residual, last.count, misfits, path)


def _fit_views(
    cameras: Sequence[Camera], outlines: Outlines, step: int, config: PersonConfig
) -> list[list[UprightView]]:
    """Return what each camera tells of its tilt and height in every `step`-th frame."""
    views = [
        fit_upright(c, own[::step], config.upright)
        for c, own in zip(cameras, outlines, strict=True)
    ]
    if any(own is None for own in views):
        unseen = [c.name for c, own in zip(cameras, views, strict=True) if own is None]
        raise InputError(f"{join_names(unseen)}: the person is seldom seen wholly; {FILM}")
    return [own for own in views if own is not None]


def _check_seen(cameras: Sequence[Camera], outlines: Outlines, config: PersonConfig) -> None:
    motions = []
    for camera, own in zip(cameras, outlines, strict=True):
        whole = [of.points for of in own if of is not None and not of.at_border.any()]
        if len(whole) < config.least_frames:
            raise InputError(
                f"{camera.name}: the whole person is in {len(whole)} of {len(own)} pictures; "
                f"expected {config.least_frames} or more; {FILM}"
            )
        edges = np.array([[*of.min(axis=0), *of.max(axis=0)] for of in whole])
        motions.append(edges.std(axis=0).max() / np.median(edges[:, 3] - edges[:, 1]))
    usual = float(np.median(motions))
    if usual < config.least_motion:
        raise InputError(
            f"the person hardly moves: the silhouettes' edges by {100 * usual:.1f} % of the "
            f"height, expected {100 * config.least_motion:g} % or more; {FILM}"
        )


def _search(
    cameras: Sequence[Camera], outlines: Outlines, views: list[list[UprightView]],
    bobbing: Sequence[np.ndarray], reach: tuple[int, int], config: PersonConfig,
) -> list[tuple[CameraRig, np.ndarray]]:  # fmt: skip
    """Return rigs and lags (V,) frames that may be right, the best first.

    reach: the greatest lag in steps, and the step in frames.
    """
    most, step = reach
    hulls = [HullRays(c, own[::step]) for c, own in zip(cameras, outlines, strict=True)]
    walkers = [[Walker.create(v, h) for v in own] for own, h in zip(views, hulls, strict=True)]
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
    """Return the start that fits best after adjustment."""
    first = [
        adjust_extremes(rig, lags, points, config.adjustment.first, step) for rig, lags in starts
    ]
    found = [(measure_misfit(own, points, step), own) for own in first if own is not None]
    found.sort(key=lambda of: of[0])
    second = [
        adjust_extremes(own.rig, own.lags, points, config.adjustment.second, step)
        for _, own in found[: config.finalists]
    ]
    final = [own for own in second if own is not None]
    if not final:
        return None
    best = min(final, key=lambda own: measure_misfit(own, points, step))
    return adjust_frontier(best.rig, best.lags, points)


def _is_sure(best: Adjusted | None, points: PersonPoints, config: PersonConfig) -> bool:
    if best is None:
        return False
    return bool(summarise_pairs(measure_pairs(best, points)).max() <= config.sure_residual)


def _adjust_grown(
    searched: Adjusted | None, grown: list[tuple[CameraRig, np.ndarray]], points: PersonPoints
) -> Adjusted | None:
    """Return the rig, searched or grown, by which most frontier points agree after adjustment."""
    first = [searched, *(adjust_frontier(rig, lags, points) for rig, lags in grown)]
    final = [adjust_farther(own, points) for own in first if own is not None]
    return max(final, key=lambda own: own.last.count, default=None)


def _check(
    best: Adjusted | None, ups: list[np.ndarray], points: PersonPoints, config: PersonConfig
) -> PersonCalibration:
    """Return the calibration in its world. Raises InputError if it cannot be trusted."""
    best, misfits, touched = _check_fit(best, points, config)
    world = align_to_person(best.rig, ups, touched, config)
    path = measure_path(world, touched)
    last = best.last
    return PersonCalibration(world, best.lags, last.residual, last.count, misfits, path)


def _check_fit(
    best: Adjusted | None, points: PersonPoints, config: PersonConfig
) -> tuple[Adjusted, np.ndarray, FrontierPoints]:
    """Return the adjusted rig, the cameras' misfits (V,), px, and its frontier points. Raises
    InputError if the silhouettes do not fit."""
    if best is None:
        raise InputError(f"no arrangement of the cameras fits the silhouettes; {FILM}")
    names, pairs = best.rig.names, measure_pairs(best, points)
    misfits = summarise_pairs(pairs)
    worst = int(np.argmax(misfits))
    if not np.isfinite(misfits[worst]):
        raise InputError(
            f"{names[worst]} shares too few pictures of the whole person with two other cameras "
            f"that do not stand opposite to it; {FILM}"
        )
    most = config.worst_residual if len(names) > 3 else config.worst_of_three
    if misfits[worst] > most:
        raise InputError(
            f"the silhouettes fit no arrangement of the cameras: those of {names[worst]} and the "
            f"other cameras differ by {misfits[worst]:.2f} px, expected at most {most:g} with "
            f"{len(names)} cameras; {FILM}"
        )
    if np.nanmax(pairs) > config.worst_pair:
        a, b = divmod(int(np.nanargmax(pairs)), len(names))
        raise InputError(
            f"the silhouettes fit no arrangement of the cameras: those of {names[a]} and "
            f"{names[b]} differ by {pairs[a, b]:.2f} px, expected at most {config.worst_pair:g}; "
            f"{FILM}"
        )
    shifts = np.round(best.lags).astype(int)
    touched = points.find_all(best.rig.cameras, shifts, config.adjustment.gates[-1])
    return best, misfits, touched

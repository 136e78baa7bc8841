"""Cameras, times and floor from the silhouettes of somebody who walks about.

Each camera tells its tilt and height, and the person's places, by itself (`upright`); angles and
lags are searched in tables of all pairs (`pairing`, `bobbing`, `search`); the best arrangements are
adjusted, and the best of these is adjusted to all frontier points (`adjustment`). If none fits, as
of somebody who stays in place, the rig is grown camera by camera (`growth`). The best rig is
adjusted until it stays. Of a large rig some cameras are found so, and the others are added to these
(`addition`). What cannot be trusted is refused (`checks`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.common.progress import Track, map_in_threads, track_silently
from psfs.self_calibration.addition import CameraAddition, choose_core
from psfs.self_calibration.adjustment import (
    Adjusted,
    PersonPoints,
    adjust_extremes,
    adjust_frontier,
    measure_misfit,
)
from psfs.self_calibration.bobbing import compare_bobbing, refine_lags
from psfs.self_calibration.checks import (
    check_directions,
    check_fit,
    check_unambiguous,
    differ,
    find_rival,
    list_lags,
    measure_worst_misfit,
)
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.growth import grow_rigs
from psfs.self_calibration.pairing import Walker, compare_pair
from psfs.self_calibration.passes import adjust_farther, settle_finely
from psfs.self_calibration.room import RoomEdges, find_room_edges
from psfs.self_calibration.search import ArrangementSearch
from psfs.self_calibration.start import place_cameras
from psfs.self_calibration.take import FILM, Outlines, PersonTake, check_seen
from psfs.self_calibration.world import align_to_person, level_rig, measure_path


@dataclass(frozen=True, eq=False)
class PersonCalibration:
    """Cameras found from a person.

    rig: small cameras, metres, Z up. lags: (V,) frames: frame t of the first camera shows the time
    of frame t + lags[v] of camera v. residual: median distance of the frontier points that agree
    from the epipolar lines, px. count: of these points. misfits: (V,) px, see `summarise_pairs`.
    path: standard deviation of the person's places along the main direction of the walk, m.
    levelled: whether up is that of the room's vertical edges; else it is that of the person.

    Standard deviations are not stated: silhouettes are wrong alike in neighbouring frames, so those
    of the least squares are several times too small.
    """

    rig: CameraRig
    lags: np.ndarray
    residual: float
    count: int
    misfits: np.ndarray
    path: float
    levelled: bool


def calibrate_by_person(
    cameras: Sequence[Camera], outlines: Outlines, edges: Sequence[np.ndarray], rate: float,
    config: PersonConfig, track: Track = track_silently,
) -> PersonCalibration:  # fmt: skip
    """Estimate the cameras' poses and lags from outlines [view][frame] at `rate` per second.

    cameras: small, with the intrinsics that are kept. edges: straight edges of the empty room in
    each camera's small picture (N, 2, 2) px, possibly none. Raises InputError, which says what to
    film, if they cannot be found.
    """
    check_number_of_cameras(len(cameras))
    take = PersonTake.create(cameras, outlines, edges, rate, config)
    core = choose_core(outlines, config.core)
    found = best = _find_rig(take.select(core), config, track)
    if found is not None and len(core) < len(cameras):
        best = _add_others(found, core, take, config, track)
    calibration = _make_calibration(best, take, config)
    if found is not None:
        check_directions(found, config)
    return calibration


def check_number_of_cameras(count: int) -> None:
    """Raise InputError if there are too few cameras."""
    if count < 3:
        raise InputError(
            f"{count} cameras; expected three or more, for two cameras' silhouettes do not tell "
            "their arrangement"
        )


def adjust_calibration(
    start: CameraRig, lags: np.ndarray, outlines: Outlines, edges: Sequence[np.ndarray],
    rate: float, config: PersonConfig,
) -> PersonCalibration:  # fmt: skip
    """Adjust small cameras in metres with Z up, and their lags, to outlines [view][frame] at `rate`
    per second and to the room's `edges`, and up and the floor to both. The scale stays as
    given. Raises InputError if the silhouettes do not fit."""
    check_seen(start.cameras, outlines, config)
    points = PersonPoints(start.cameras, outlines, config.adjustment)
    step = max(1, round(rate / config.table_rate))
    best = _adjust_first(
        _rank_starts([(start, lags)], points, step, config, track_silently), points
    )
    up = np.array([0.0, 0.0, 1.0])
    if best is not None:
        best = settle_finely(best, points, lambda rig: find_room_edges(rig, edges, up, config))
    best, misfits, touched = check_fit(best, points, config)
    last, (rig, levelled) = best.last, level_rig(best, points, edges, touched, config)
    path = measure_path(rig, touched)
    return PersonCalibration(rig, best.lags, last.residual, last.count, misfits, path, levelled)


def _find_rig(take: PersonTake, config: PersonConfig, track: Track) -> Adjusted | None:
    """Return the rig that fits best, searched or grown."""
    starts = _search(take, config, track)
    ranked = _rank_starts(starts, take.points, take.step, config, track)
    best = _adjust_first(ranked, take.points)
    rival = None
    if best is not None and measure_worst_misfit(best, take.points) <= config.sure_residual:
        rival = find_rival(best, ranked, take.points, take.step, config)
    elif starts:
        lags = refine_lags(take.bobbing, starts[0][1], take.step, config.pairs)
        grown = grow_rigs(take.cameras, lags, take.points, config, track)
        best = adjust_grown(best, grown, take.points, track)
        if best is None:
            late = list_lags(take.cameras, lags - lags[0])
            raise InputError(
                "no arrangement of the cameras fits the silhouettes; frames late, to about half a "
                f"frame, by the head's ups and downs: {late}; {FILM}"
            )
    if best is None:
        return None

    def find_edges(rig: CameraRig) -> RoomEdges | None:
        return find_room_edges(rig, take.edges, take.find_up(rig), config)

    best = settle_finely(best, take.points, find_edges)
    if rival is not None:  # gait repeats itself: limbs and the room tell more
        rival = settle_finely(rival, take.points, find_edges)
        check_unambiguous(best, rival, take.points, take.step, config)
    return best


def _add_others(
    found: Adjusted, core: Sequence[int], take: PersonTake, config: PersonConfig, track: Track
) -> Adjusted | None:
    """Return the rig with the take's other cameras, too."""
    addition = CameraAddition(found, core, take, config)
    placed = dict(zip(core, zip(addition.rig, addition.lags, strict=True), strict=True))
    others = [view for view in range(len(take.cameras)) if view not in placed]
    added = track(map_in_threads(addition.add, others), len(others), "further cameras")
    placed |= dict(zip(others, added, strict=True))
    cameras, lags = zip(*(placed[view] for view in sorted(placed)), strict=True)
    gates = config.adjustment.far_gates
    return adjust_frontier(CameraRig(cameras), np.array(lags), take.points, gates)


def _search(
    take: PersonTake, config: PersonConfig, track: Track
) -> list[tuple[CameraRig, np.ndarray]]:
    """Return rigs and lags (V,) frames that may be right, the best first."""
    hulls, count = take.trace_hulls(), len(take.cameras)
    walkers = [[Walker.create(v, h) for v in own] for own, h in zip(take.views, hulls, strict=True)]
    angles = 2 * np.pi * np.arange(config.angles) / config.angles
    pairs = list(combinations(range(count), 2))

    def compare(pair: tuple[int, int]) -> np.ndarray:
        a, b = pair
        costs = [
            [compare_pair(x, y, angles, take.most, config.pairs) for y in walkers[b]]
            for x in walkers[a]
        ]
        bobbing = take.bobbing[a], take.bobbing[b]
        return np.array(costs) + compare_bobbing(*bobbing, take.most, take.step, config.pairs)

    found = track(map_in_threads(compare, pairs), len(pairs), "pairs of cameras")
    tables, starts = dict(zip(pairs, found, strict=True)), []
    for arrangement in ArrangementSearch(tables, count, config.search).find(config.candidates):
        chosen = [own[k] for own, k in zip(take.views, arrangement.variants, strict=True)]
        turned = angles[list(arrangement.angles)]
        rig = place_cameras(take.cameras, chosen, turned, arrangement.lags, config.stature)
        starts.append((rig, take.step * np.array(arrangement.lags, float)))
    return starts


def _rank_starts(
    starts: list[tuple[CameraRig, np.ndarray]], points: PersonPoints, step: int,
    config: PersonConfig, track: Track,
) -> list[tuple[float, Adjusted]]:  # fmt: skip
    """Return the misfits and rigs of the start that fits best after adjustment, and of the best
    other one."""
    first = [
        adjust_extremes(rig, lags, points, config.adjustment.first, step)
        for rig, lags in track(starts, len(starts), "arrangements")
    ]
    found = [(measure_misfit(own, points, step), own) for own in first if own is not None]
    found.sort(key=lambda of: of[0])

    def finish(started: Sequence[tuple[float, Adjusted]]) -> list[tuple[float, Adjusted]]:
        rounds = config.adjustment.second
        second = [adjust_extremes(own.rig, own.lags, points, rounds, step) for _, own in started]
        return [(measure_misfit(own, points, step), own) for own in second if own is not None]

    ranked = sorted(finish(found[: config.finalists]), key=lambda of: of[0])
    if not ranked:
        return []
    others = [of for of in found if differ(of[1], ranked[0][1], step, config)]
    rivals = [of for of in ranked if differ(of[1], ranked[0][1], step, config)]
    return [ranked[0], *sorted([*rivals, *finish(others[:1])], key=lambda of: of[0])[:1]]


def _adjust_first(ranked: list[tuple[float, Adjusted]], points: PersonPoints) -> Adjusted | None:
    """Return the first rig after adjustment to all frontier points."""
    return adjust_frontier(ranked[0][1].rig, ranked[0][1].lags, points) if ranked else None


def adjust_grown(
    searched: Adjusted | None, grown: list[tuple[CameraRig, np.ndarray]], points: PersonPoints,
    track: Track,
) -> Adjusted | None:  # fmt: skip
    """Return the rig, searched or grown, whose worst camera fits best after adjustment."""
    first = [searched, *(adjust_frontier(rig, lags, points) for rig, lags in grown)]
    found = [own for own in first if own is not None]
    final = [adjust_farther(own, points) for own in track(found, len(found), "best rigs")]
    return min(final, key=lambda own: measure_worst_misfit(own, points), default=None)


def _make_calibration(
    best: Adjusted | None, take: PersonTake, config: PersonConfig
) -> PersonCalibration:
    """Return the calibration in its world. Raises InputError if it cannot be trusted."""
    best, misfits, touched = check_fit(best, take.points, config)
    world, levelled = align_to_person(best, take, touched, config)
    path = measure_path(world, touched)
    last = best.last
    return PersonCalibration(world, best.lags, last.residual, last.count, misfits, path, levelled)

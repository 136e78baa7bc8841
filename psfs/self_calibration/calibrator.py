"""Cameras, times and floor from the silhouettes of somebody who walks about.

Each camera tells its tilt and height, and the person's places, by itself (`upright`); angles and
lags are searched in tables of all pairs (`search`); the best ones are
adjusted, and the best of these is adjusted to all frontier points (`adjustment`) until it stays. Of
a large rig all cameras are compared with some, and arrangements by some. What cannot be trusted is
refused (`checks`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.common.progress import Track, map_in_threads, track_silently
from psfs.diagnostics.frontier import FrontierPoints
from psfs.diagnostics.hulls import find_person
from psfs.diagnostics.limbs import LimbPoints, measure_limbs
from psfs.self_calibration.adjustment import (
    FIRST,
    LAST_GATE,
    SECOND,
    Adjusted,
    MeasureShifted,
    PersonPoints,
    adjust_extremes,
    adjust_frontier,
    differ,
    measure_misfit,
    measure_misfits,
    refine_until_converged,
)
from psfs.self_calibration.checks import (
    check_fit,
    check_unambiguous,
    check_uncertainty,
    fits_as_well,
    measure_uncertainty,
)
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.room_edges import find_room_edges
from psfs.self_calibration.search import (
    Arrangement,
    ArrangementSearch,
    compare_pair,
    place_cameras,
)
from psfs.self_calibration.take import Outlines, PersonTake, check_seen
from psfs.self_calibration.world import (
    align_to_person,
    level_rig,
    measure_path,
    measure_places,
)

#: Arrangements from the search that are adjusted, and those of these that are adjusted further, and
#: places of one camera that are tried.
_CANDIDATES, _FINALISTS = 12, 3
#: Misfit of the worst camera above which rivals are adjusted until they stay, too, px.
_SURE = 0.7
#: Most cameras by which arrangements are compared, and number of these with which all others are.
CORE, _ANCHORS = 8, 4


@dataclass(frozen=True, eq=False)
class PersonCalibration:
    """Cameras found from a person.

    rig: small cameras, metres, Z up. lags: (V,) frames: frame t of the first camera shows the time
    of frame t + lags[v] of camera v. residual: median distance of the frontier points that agree
    from the epipolar lines, px. count: of these points. misfits: (V,) px, see `measure_misfits`.
    path: standard deviation of the person's places along the main direction of the walk, m.
    levelled: whether up is that of the room's vertical edges; else it is that of the person.
    turns, shifts: (V,) standard deviations of directions, rad, and of positions, as shares of the
    distance from the person; none for cameras from keypoints.
    """

    rig: CameraRig
    lags: np.ndarray
    residual: float
    count: int
    misfits: np.ndarray
    path: float
    levelled: bool
    turns: np.ndarray | None = None
    shifts: np.ndarray | None = None


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
    take = PersonTake(cameras, outlines, edges, rate, config)
    best = _find_rig(take, rate, track)
    return _make_calibration(
        best, take.points, rate, lambda adjusted, touched: align_to_person(adjusted, take, touched)
    )


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
    check_seen(start.cameras, outlines)
    points = PersonPoints(start.cameras, outlines, config)
    best = adjust_extremes(start, lags, points, FIRST + SECOND)
    best = None if best is None else adjust_frontier(best, points)
    if best is not None:
        best = _refine_finely(best, points, edges, lambda rig: np.array([0.0, 0.0, 1.0]))
    return _make_calibration(
        best, points, rate, lambda adjusted, touched: level_rig(adjusted, points, edges, touched)
    )


def _find_rig(take: PersonTake, rate: float, track: Track) -> Adjusted | None:
    """Return the rig that fits best, searched or grown."""
    # Arrangements are compared by the cameras that see the whole person in most pictures.
    order = np.argsort(np.negative(take.points.whole), kind="stable")
    core = [int(view) for view in order[:CORE]]
    ranked = _rank_starts(_search(take, core, track), take, core, track)
    first = [adjust_frontier(rig, take.points) for rig in ranked]
    candidates = [rig for rig in first if rig is not None]
    if not candidates:
        return None
    if measure_misfits(candidates[0], take.points).max() > _SURE:
        candidates = [
            refine_until_converged(rig, take.points, far=True)
            for rig in track(candidates, len(candidates), "best rigs")
        ]
        candidates.sort(key=lambda rig: measure_misfits(rig, take.points).max())
    best = _refine_finely(candidates[0], take.points, take.edges, take.find_up)
    for rival in [other for other in candidates[1:] if differ(other, best)][:1]:
        if fits_as_well(rival, best, take.points, rate):
            # Gait repeats itself: limbs and the room tell more.
            rival = _refine_finely(rival, take.points, take.edges, take.find_up)
            check_unambiguous(best, rival, take.points, rate)
    return best


def _search(take: PersonTake, core: Sequence[int], track: Track) -> ArrangementSearch:
    """Return the search among the costs of the cameras' pairs."""
    count = len(take.cameras)
    pairs = [
        pair
        for pair in combinations(range(count), 2)
        if {*pair} <= {*core} or {*pair} & {*core[:_ANCHORS]}
    ]

    def compare(pair: tuple[int, int]) -> np.ndarray:
        return compare_pair(take.views[pair[0]], take.views[pair[1]], take.most)

    costs_of_pairs = track(map_in_threads(compare, pairs), len(pairs), "pairs of cameras")
    return ArrangementSearch(dict(zip(pairs, costs_of_pairs, strict=True)), count)


def _rank_starts(
    search: ArrangementSearch, take: PersonTake, core: Sequence[int], track: Track
) -> list[Adjusted]:
    """Return the rig that fits best after adjustment, and the best other one.

    The arrangements that fit best by the core are tried again with one camera elsewhere: the lag of
    a camera is often found half a stride off, where the others tell it, and the core does not tell
    where the rest stands.
    """
    whole, step = take.points, take.step

    def adjust(
        arrangements: Sequence[Arrangement], views: Sequence[int], points: PersonPoints, name: str
    ) -> list[tuple[Adjusted, Arrangement]]:
        best = []
        for tried in track(arrangements, len(arrangements), name):
            rig = place_cameras(take.cameras, take.views, tried, points.config.stature)
            placed = CameraRig(tuple(rig[view] for view in views))
            lags = step * np.array([tried[view][1] for view in views], float)
            adjusted = adjust_extremes(placed, lags, points, FIRST, step)
            best += [] if adjusted is None else [(adjusted, tried)]
        best.sort(key=lambda entry: measure_misfit(entry[0], points, step))
        others = [entry for entry in best[_FINALISTS:] if differ(entry[0], best[0][0])]
        return best[:_FINALISTS] + others[:1]

    views, everyone = sorted(core), range(len(take.cameras))
    best = adjust(search.find(_CANDIDATES), views, whole.select(views), "arrangements")
    if best:
        tried = [*(entry[1] for entry in best), *search.move_one(best[0][1], _FINALISTS)]
        best = adjust(tried, everyone, whole, "places of one camera")
    finished = [adjust_extremes(pair.rig, pair.lags, whole, SECOND, step) for pair, _ in best]
    ranked = [pair for pair in finished if pair is not None]
    ranked.sort(key=lambda rig: measure_misfit(rig, whole, step))
    return ranked[:1] + [rig_start for rig_start in ranked if differ(rig_start, ranked[0])][:1]


def _make_calibration(
    best: Adjusted | None, points: PersonPoints, rate: float,
    align: Callable[[Adjusted, FrontierPoints], tuple[CameraRig, bool]],
) -> PersonCalibration:  # fmt: skip
    """Return the calibration in its world. Raises InputError if it cannot be trusted."""
    best, misfits = check_fit(best, points)
    turns, moves = measure_uncertainty(best, points, rate)
    check_uncertainty(best, turns, moves, points)
    touched = points.find_all(best.shifts, best.rig.cameras, LAST_GATE)
    rig, levelled = align(best, touched)
    path = measure_path(measure_places(rig, touched)[1])
    return PersonCalibration(
        rig, best.lags, best.last.residual, best.last.count, misfits, path, levelled, turns, moves
    )


def _refine_finely(
    start: Adjusted, points: PersonPoints, edges: Sequence[np.ndarray],
    find_up: Callable[[CameraRig], np.ndarray],
) -> Adjusted:  # fmt: skip
    """Adjust a rig to frontier points and the room's edges until it stays, then to points on limbs'
    axes, too. find_up: tells the person's up (3,)."""
    axes, sights = measure_limbs(points.hulls, points.contours)

    def prepare(adjusted: Adjusted) -> MeasureShifted:
        room = find_room_edges(adjusted.rig, edges, find_up(adjusted.rig))
        further = [] if room is None else [room.bind()]
        return lambda shifts: further

    def prepare_limbs(adjusted: Adjusted) -> MeasureShifted:
        room, cameras = prepare(adjusted), adjusted.rig.cameras
        limbs = LimbPoints(cameras, adjusted.lags, axes, *find_person(cameras, sights))
        return lambda shifts: [*room(shifts), limbs.bind(shifts)]

    adjusted = refine_until_converged(start, points, prepare)
    return refine_until_converged(adjusted, points, prepare_limbs)

"""Calibrate cameras from sightings of a board or wand.

Find a start, adjust the bundle, reject false detections, and set aside cameras that disagree with
the others, saying why. Every comparison is a test of two variances (F test), of which sightings,
not their points, are independent, with one rate of false alarms.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import cv2
import numpy as np
import scipy

from cl import InputError
from psfs.calibration.bundle import LENS_PARAMETERS, adjust_bundle, compare_lenses
from psfs.calibration.scene import GOOD, OUTLIER, CalibrationScene, reprojection_errors, rms
from psfs.calibration.start.board import place_cameras_by_board
from psfs.calibration.start.motion_capture import place_cameras_by_markers
from psfs.calibration.start.placing import (
    FEW_BOARDS,
    FEW_WANDS,
    check_linked,
    count_shared_frames,
    default_camera,
    estimate_camera_from_boards,
    find_spanning_pairs,
)
from psfs.calibration.start.wand import estimate_focal_lengths, place_cameras_by_wand
from psfs.calibration.targets.target import Sighting, Target, group_by_view, select_shared
from psfs.cameras.camera import Camera
from psfs.cameras.names import join_names
from psfs.common.numbers import FALSE_ALARMS, pick_evenly

#: Fewest cameras among which an outlier can be found.
_FEWEST = 3
#: Most sightings of a camera that are compared, and greatest delay that is tried, frames.
_SAMPLED, _MOST_LATE = 60, 5


def find_outlier_camera(
    scene: CalibrationScene, sightings: Sequence[Sighting], views: Sequence[int]
) -> int | None:
    """Find the one of the cameras `views` that fits the others much worse than they fit each other.

    In an adjusted scene, for the noise of each camera is estimated there and an outlier counts
    little. It also raises the errors of the others, but not by as much as its own; a board that is
    bent raises all. None if no camera does.
    """
    groups = group_by_view(sightings, len(scene.cameras))
    seen = [view for view in views if len(groups[view]) > 3]
    if len(seen) < _FEWEST:
        return None
    errors = [reprojection_errors(scene, groups[view]) for view in seen]
    view_errors = np.array([rms(error) for error in errors])
    others = [rms(np.concatenate([*errors[:k], *errors[k + 1 :]])) for k in range(len(seen))]
    scores = view_errors / np.maximum(others, 1e-9)
    worst = int(scores.argmax())
    usual = float(np.median(np.delete(scores, worst)))
    counts = [len(groups[view]) for view in seen]
    limit = np.sqrt(_limit_ratio(counts[worst], sum(counts) - counts[worst]))
    clear = scores[worst] > limit * max(1.0, usual) and view_errors[worst] > GOOD
    return seen[worst] if clear else None


def _limit_ratio(first: int, second: int) -> float:
    """Return the ratio of two variances, of so many independent errors, that chance exceeds at the
    rate of false alarms."""
    return float(scipy.special.fdtri(first, second, 1 - FALSE_ALARMS))


def explain_disagreement(scene: CalibrationScene, sightings: Sequence[Sighting]) -> str:
    """Explain why a camera disagrees: it was moved, is late, or its intrinsics are wrong.

    Returns how much it does and the reason that removes most of the error. scene: of the others,
    with this one where it fits best. sightings: its own.
    """
    every = [sightings[k] for k in pick_evenly(len(sightings), _SAMPLED)]
    error = rms(reprojection_errors(scene, every))
    guesses = (guess(scene, every) for guess in (_guess_moved, _guess_late, _guess_lens))
    left, text = min(chain.from_iterable(guesses), key=lambda guess: guess[0])
    if error**2 < _limit_ratio(len(every), len(every)) * left**2:
        text = "it was moved, filmed something else, or its lens or focus changed"
    else:
        text = f"{text} ({left:.1f} px then)"
    return f"{error:.1f} px off what the others see; {text}"


def _fit_camera(
    scene: CalibrationScene,
    sightings: Sequence[Sighting],
    lens: bool = False,
) -> tuple[np.ndarray, CalibrationScene]:
    """Fit one camera to its sightings; return its errors (N,) px and the scene.

    lens: fit its intrinsics too.
    """
    view = sightings[0].view
    held = [other for other in range(len(scene.cameras)) if other != view]
    scene = adjust_bundle(scene, sightings, [view] if lens else [], held, poses=False)
    return reprojection_errors(scene, sightings), scene


def _guess_moved(scene: CalibrationScene, sightings: list[Sighting]) -> Iterator[tuple[float, str]]:
    for share in np.linspace(0.1, 0.9, 9):
        at = round(share * len(sightings))
        parts = sightings[:at], sightings[at:]
        if min(len(part) for part in parts) < 3:
            continue
        (one, before), (two, after) = (_fit_camera(scene, part) for part in parts)
        view = sightings[0].view
        away = np.linalg.norm(before.cameras[view].centre - after.cameras[view].centre)
        turn = before.cameras[view].R @ after.cameras[view].R.T
        angle = np.degrees(np.linalg.norm(cv2.Rodrigues(turn)[0]))
        when = parts[1][0].frame // scene.target.boards
        text = f"it was moved near frame {when}, by {1000 * away:.0f} mm and {angle:.1f} degrees"
        yield rms(np.concatenate([one, two])), text


def _guess_late(scene: CalibrationScene, sightings: list[Sighting]) -> Iterator[tuple[float, str]]:
    name = scene.cameras[sightings[0].view].name
    for late in (*range(-_MOST_LATE, 0), *range(1, _MOST_LATE + 1)):
        shifted = [replace(s, frame=s.frame - late * scene.target.boards) for s in sightings]
        shifted = [s for s in shifted if s.frame in scene.poses]
        if len(shifted) >= max(4, len(sightings) // 2):
            word = "late" if late > 0 else "early"
            text = f"it comes {abs(late)} frames {word}: state --sync {name}={late}"
            left = rms(_fit_camera(scene, shifted)[0])
            yield left, f"{text}, or add {late} to its present lag"


def _guess_lens(scene: CalibrationScene, sightings: list[Sighting]) -> Iterator[tuple[float, str]]:
    errors, fitted = _fit_camera(scene, sightings, lens=True)
    view = sightings[0].view
    yield rms(errors), describe_lens_change(scene.cameras[view], fitted.cameras[view])


def describe_lens_change(stated: Camera, wanted: Camera) -> str:
    """Describe how a camera's pictures contradict its given intrinsics."""
    focal = wanted.K[0, 0] / stated.K[0, 0] - 1
    x, y = wanted.K[:2, 2] - stated.K[:2, 2]
    return (
        f"its intrinsics do not fit its pictures, which want a focal length of "
        f"{wanted.K[0, 0]:.0f} px ({100 * focal:+.1f} %) and a centre {x:+.0f}, {y:+.0f} px away"
    )


def find_wrong_intrinsics(
    scene: CalibrationScene, sightings: Sequence[Sighting], views: Sequence[int]
) -> dict[int, Camera]:
    """Find the cameras among `views` whose given intrinsics do not fit, with the fitted ones.

    If the model describes all lenses or boards only roughly, F is higher than 1 for all cameras.
    """
    held = () if scene.target.known is not None else (views[0],)
    tests = compare_lenses(scene, sightings, views, held)
    ratios = sorted(ratio for ratio, _ in tests.values())
    limit = _limit_ratio(LENS_PARAMETERS, len(sightings)) * max(
        1.0, float(np.median(ratios[:-1] or [1.0]))
    )
    return {view: camera for view, (ratio, camera) in tests.items() if ratio > limit}


#: Largest skew of known intrinsics, px, which moves pixels by less than a tenth of one.
_MOST_SKEW = 0.1
#: Share of a camera's sightings that may be false detections; with more, the camera disagrees.
_FALSE = 0.1


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """Result of a calibration.

    scene: cameras and target poses. sightings: those that were used. dropped: number of rejected
    sightings by camera. disagreeing: for each camera that disagrees with the others, why; the
    others were calibrated without it, and it was then placed where it fits best. misfits: for each
    camera whose given intrinsics do not fit, why; it was used nevertheless. shared: number of
    frames that each pair of cameras shares (V, V).
    """

    scene: CalibrationScene
    sightings: list[Sighting]
    dropped: dict[str, int]
    disagreeing: dict[str, str]
    misfits: dict[str, str]
    shared: np.ndarray

    def transform(self, world: np.ndarray) -> CalibrationResult:
        """Transform the result to another world, x' = world x, (4, 4)."""
        return replace(self, scene=self.scene.transform(world))


def calibrate_cameras(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    lenses_known: bool,
) -> CalibrationResult:
    """Estimate the cameras' poses, and their intrinsics unless these are known.

    cameras: names, sizes and, with `lenses_known`, intrinsics that are kept. Raises InputError if
    the sightings do not suffice.
    """
    names = [camera.name for camera in cameras]
    _check_lenses(cameras)
    if target.known is not None:
        sightings = [s for s in sightings if s.frame in target.known]
    shared = count_shared_frames(sightings, len(cameras))
    scene, ordered = _initialise(cameras, target, sightings, shared, lenses_known)
    everyone = range(len(cameras))
    lenses = () if lenses_known else everyone
    held, poses = _choose_anchor(shared, target), target.known is None
    scene = adjust_bundle(scene, ordered, lenses, held, poses)
    accepted = _reject_false(scene, ordered)
    if len(accepted) < len(ordered):
        scene = adjust_bundle(scene, accepted, lenses, held, poses)
    scene, agreeing, disagreeing = _exclude_outlier_cameras(scene, accepted, lenses)
    error = rms(np.minimum(reprojection_errors(scene, agreeing), 1e3))
    if not error <= OUTLIER:  # also NaN, of no sighting at all
        raise InputError(
            f"the sightings of the {target.name} fit no arrangement of the cameras; expected "
            "pictures of the same time, one rigid target of the stated size, cameras that stay"
        )
    misfits: dict[str, str] = {}
    if lenses_known:
        views = [view for view in everyone if names[view] not in disagreeing]
        wanted = find_wrong_intrinsics(scene, agreeing, views)
        misfits = {names[v]: describe_lens_change(cameras[v], wanted[v]) for v in wanted}
    dropped = [len(group) for group in group_by_view(ordered, len(cameras))]
    for view, view_sightings in enumerate(group_by_view(accepted, len(cameras))):
        dropped[view] -= len(view_sightings)
    fitting = [s for s in accepted if s.frame in scene.poses]
    return CalibrationResult(
        scene, fitting, dict(zip(names, dropped, strict=True)), disagreeing, misfits, shared
    )


def _check_lenses(cameras: Sequence[Camera]) -> None:
    """Raise InputError for lenses that OpenCV's projection, which the bundle adjustment uses,
    ignores."""
    for camera in cameras:
        skew = camera.K[0, 1]
        if camera.kappa or camera.fisheye or abs(skew) > _MOST_SKEW:
            model = "Tsai's distortion" if camera.kappa else f"a skew of {skew:g} px"
            model = "a fisheye lens" if camera.fisheye else model
            raise InputError(
                f"the intrinsics of {camera.name} have {model}; expected k1, k2, p1, p2, k3 and no "
                "skew, or no --intrinsics"
            )


def _initialise(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    shared: np.ndarray,
    lenses_known: bool,
) -> tuple[CalibrationScene, list[Sighting]]:
    """Estimate the initial cameras and target poses; return the sightings in order of their
    points."""
    names = [camera.name for camera in cameras]
    blind = [name for name, count in zip(names, np.diag(shared), strict=True) if not count]
    if blind:
        raise InputError(
            f"{join_names(blind)}: the {target.name} is in none of the pictures; expected it in "
            "all cameras' (or --cameras without these)"
        )
    groups = group_by_view(sightings, len(cameras))
    if not lenses_known and target.planar:
        cameras = [
            estimate_camera_from_boards(camera.name, camera.size, target, view_sightings)
            for camera, view_sightings in zip(cameras, groups, strict=True)
        ]
    elif not lenses_known:
        cameras = [default_camera(camera.name, camera.size) for camera in cameras]
    if target.known is not None:
        return place_cameras_by_markers(cameras, target, sightings, lenses_known)
    if len(cameras) < 2:
        raise InputError("a single camera; expected two or more that see the target together")
    fewest = FEW_BOARDS if target.planar else FEW_WANDS
    check_linked(shared, fewest, names, target.name)
    pairs = find_spanning_pairs(shared, fewest)
    if target.planar:
        return place_cameras_by_board(cameras, target, sightings, pairs)
    if not lenses_known:
        cameras = estimate_focal_lengths(cameras, target, sightings, pairs)
    return place_cameras_by_wand(cameras, target, sightings, pairs)


def _choose_anchor(shared: np.ndarray, target: Target) -> tuple[int, ...]:
    """Return the camera that is held fixed while the world's axes are not yet defined."""
    if target.known is not None:
        return ()
    return (int((shared - np.diag(np.diag(shared))).sum(axis=1).argmax()),)


def _reject_false(
    scene: CalibrationScene,
    sightings: Sequence[Sighting],
) -> list[Sighting]:
    """Reject sightings with large errors, except of cameras that have many of them."""
    accepted: list[Sighting] = []
    for group in group_by_view(sightings, len(scene.cameras)):
        good = [s for s in group if np.median(reprojection_errors(scene, [s])) < OUTLIER]
        least = (1 - _FALSE) * len(group)
        accepted += good if len(good) >= least else group
    return select_shared(accepted, scene.target)


def _exclude_outlier_cameras(
    scene: CalibrationScene, sightings: list[Sighting], lenses: Sequence[int]
) -> tuple[CalibrationScene, list[Sighting], dict[str, str]]:
    """Set aside, one at a time, the cameras that disagree with the others.

    Returns the scene estimated from the cameras that agree, their sightings, and why each of the
    others disagrees, by name; these are placed where they fit best. If half of the cameras or more
    disagree, no majority says which are wrong, and all are kept.
    """
    names = [camera.name for camera in scene.cameras]
    everything = scene, sightings, dict[str, str]()
    views = list(range(len(names)))
    disagreeing: dict[str, str] = {}
    used = sightings
    while (view := find_outlier_camera(scene, used, views)) is not None:
        views.remove(view)
        used = select_shared([s for s in sightings if s.view in views], scene.target)
        free, moves = [other for other in lenses if other in views], scene.target.known is None
        # Where the target moves, the first camera holds the world's axes.
        moving = views[1:] if moves else views
        held = [v for v in range(len(names)) if v not in moving]
        scene = adjust_bundle(scene, used, free, held, moves)
        others = [other for other in range(len(names)) if other != view]
        of_view = [s for s in sightings if s.view == view and s.frame in scene.poses]
        scene = adjust_bundle(scene, of_view, (), others, poses=False)
        disagreeing[names[view]] = explain_disagreement(scene, of_view)
        if 2 * len(disagreeing) >= len(names):
            return everything
    return scene, [s for s in sightings if s.view in views and s.frame in scene.poses], disagreeing

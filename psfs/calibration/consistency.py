"""Find the cameras that disagree with the others, and why, by leaving each out in turn.

Every comparison is a test of two variances (F test), of which sightings, not their points, are
independent, with one rate of false alarms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import scipy

from psfs.calibration.bundle import FreeParameters, adjust_bundle
from psfs.calibration.config import CalibrationConfig
from psfs.calibration.scene import CalibrationScene, all_reprojection_errors, rms
from psfs.calibration.targets.target import Sighting, Target, select_shared
from psfs.cameras.camera import Camera
from psfs.common.numbers import pick_evenly

#: Fewest cameras among which an outlier can be found; number of intrinsics of a camera.
_FEWEST, _PARAMETERS = 3, 8
#: Most sightings of a camera that are compared, and greatest delay that is tried, frames.
_SAMPLED, _MOST_LATE = 60, 5


@dataclass(frozen=True, eq=False)
class CameraComparison:
    """Comparison of a camera with the others.

    view: its index. scene: estimated from the other cameras alone, with this one placed where it
    fits best. sightings: its own, in frames that the others see. own, others: root mean square
    error of its own and of the others' sightings, px.
    """

    view: int
    scene: CalibrationScene
    sightings: list[Sighting]
    own: float
    others: float


def compare_cameras(
    scene: CalibrationScene,
    target: Target,
    sightings: Sequence[Sighting],
    views: Sequence[int],
    config: CalibrationConfig,
) -> list[CameraComparison]:
    """Compare each of the cameras `views` with the others, where they share enough frames."""
    frames = sorted({sighting.frame for sighting in sightings})
    picked = {frames[k] for k in pick_evenly(len(frames), _SAMPLED)}
    used = [s for s in sightings if s.frame in picked and s.view in views]
    found = [_compare_camera(scene, target, used, view, views, config) for view in views]
    return [trial for trial in found if trial is not None]


def _compare_camera(
    scene: CalibrationScene,
    target: Target,
    sightings: Sequence[Sighting],
    view: int,
    views: Sequence[int],
    config: CalibrationConfig,
) -> CameraComparison | None:
    needed = 1 if target.known is not None else 2
    rest = select_shared([s for s in sightings if s.view != view], needed)
    seen = {s.frame for s in rest}
    own = [s for s in sightings if s.view == view and s.frame in seen]
    if len(own) < 4:
        return None
    count = len(scene.cameras)
    if target.known is None:
        anchor = next(other for other in views if other != view)
        away = tuple(v for v in range(count) if v not in views)
        scene = adjust_bundle(
            scene, target, rest, FreeParameters(held=(anchor, view, *away)), config
        )
    held = tuple(other for other in range(count) if other != view)
    scene = adjust_bundle(scene, target, own, FreeParameters(held=held, poses=False), config)
    left = all_reprojection_errors(scene, target, own), all_reprojection_errors(scene, target, rest)
    return CameraComparison(view, scene, own, *map(rms, left))


def find_outlier_camera(
    found: Sequence[CameraComparison], config: CalibrationConfig
) -> CameraComparison | None:
    """Find the camera that fits the others much worse than they fit each other.

    An outlier also raises the errors of the others, but not by as much as its own; a board that is
    bent raises all. None if no camera does.
    """
    if len(found) < _FEWEST:
        return None
    scores = np.array([trial.own / max(trial.others, 1e-9) for trial in found])
    worst = int(scores.argmax())
    usual = float(np.median(np.delete(scores, worst)))
    counts = [len(trial.sightings) for trial in found]
    limit = np.sqrt(_limit_ratio(config, counts[worst], sum(counts) - counts[worst]))
    clear = scores[worst] > limit * max(1.0, usual) and found[worst].own > config.noise
    return found[worst] if clear else None


def _limit_ratio(config: CalibrationConfig, first: int, second: int) -> float:
    """Return the ratio of two variances, of so many independent errors, that chance exceeds at the
    rate of false alarms."""
    return float(scipy.stats.f.ppf(1 - config.false_alarms, first, second))


def explain_disagreement(
    trial: CameraComparison, target: Target, every: Sequence[Sighting], config: CalibrationConfig
) -> str:
    """Explain why a camera disagrees: it was moved, is late, or its intrinsics are wrong.

    Returns the reason that removes most of the error. every: its sightings in all frames.
    """
    view, scene = trial.view, trial.scene
    every = [s for s in every if s.view == view and s.frame in scene.poses]
    every = [every[k] for k in pick_evenly(len(every), _SAMPLED)]
    guesses = [
        _test_moved(scene, target, every, config),
        _test_late(scene, target, every, config),
        _test_lens(trial, target, config),
    ]
    left, text = min(guesses)
    if trial.own**2 < _limit_ratio(config, len(every), len(every)) * left**2:
        return "it was moved, filmed something else, or its lens or focus changed"
    return f"{text} ({left:.1f} px then)"


def _fit_camera(
    scene: CalibrationScene,
    target: Target,
    sightings: Sequence[Sighting],
    config: CalibrationConfig,
    lens: bool = False,
) -> tuple[np.ndarray, CalibrationScene]:
    """Fit one camera to its sightings; return its errors (N,) px and the scene.

    lens: fit its intrinsics too.
    """
    view = sightings[0].view
    held = tuple(other for other in range(len(scene.cameras)) if other != view)
    freedom = FreeParameters((view,) if lens else (), held, poses=False)
    scene = adjust_bundle(scene, target, sightings, freedom, config)
    return all_reprojection_errors(scene, target, sightings), scene


def _test_moved(
    scene: CalibrationScene, target: Target, sightings: list[Sighting], config: CalibrationConfig
) -> tuple[float, str]:
    best = np.inf, ""
    for share in np.linspace(0.1, 0.9, 9):
        at = round(share * len(sightings))
        parts = sightings[:at], sightings[at:]
        if min(len(part) for part in parts) < 3:
            continue
        (one, before), (two, after) = (_fit_camera(scene, target, part, config) for part in parts)
        left = rms(np.concatenate([one, two]))
        if left < best[0]:
            view = sightings[0].view
            away = np.linalg.norm(before.cameras[view].centre - after.cameras[view].centre)
            turn = before.cameras[view].R @ after.cameras[view].R.T
            angle = np.degrees(np.linalg.norm(cv2.Rodrigues(turn)[0]))
            when = parts[1][0].frame // target.boards
            text = f"it was moved near frame {when}, by {1000 * away:.0f} mm"
            best = left, f"{text} and {angle:.1f} degrees"
    return best


def _test_late(
    scene: CalibrationScene, target: Target, sightings: list[Sighting], config: CalibrationConfig
) -> tuple[float, str]:
    best, most = (np.inf, ""), _MOST_LATE
    for late in (*range(-most, 0), *range(1, most + 1)):
        shifted = [replace(s, frame=s.frame - late * target.boards) for s in sightings]
        shifted = [s for s in shifted if s.frame in scene.poses]
        if len(shifted) >= max(4, len(sightings) // 2):
            left = rms(_fit_camera(scene, target, shifted, config)[0])
            if left < best[0]:
                word, name = "late" if late > 0 else "early", scene.cameras[sightings[0].view].name
                text = f"it comes {abs(late)} frames {word}: state --sync {name}={late}"
                best = left, f"{text}, or add {late} to its present lag"
    return best


def _test_lens(
    trial: CameraComparison, target: Target, config: CalibrationConfig
) -> tuple[float, str]:
    errors, fitted = _fit_camera(trial.scene, target, trial.sightings, config, lens=True)
    wanted, given = (of.cameras[trial.view] for of in (fitted, trial.scene))
    return rms(errors), describe_lens_change(given, wanted)


def describe_lens_change(given: Camera, wanted: Camera) -> str:
    """Describe how a camera's pictures contradict its given intrinsics."""
    focal = wanted.K[0, 0] / given.K[0, 0] - 1
    x, y = wanted.K[:2, 2] - given.K[:2, 2]
    return (
        f"its intrinsics do not fit its pictures, which want a focal length of "
        f"{wanted.K[0, 0]:.0f} px ({100 * focal:+.1f} %) and a centre {x:+.0f}, {y:+.0f} px away"
    )


def find_wrong_intrinsics(
    scene: CalibrationScene,
    target: Target,
    sightings: Sequence[Sighting],
    views: Sequence[int],
    config: CalibrationConfig,
) -> dict[int, Camera]:
    """Find the cameras among `views` whose given intrinsics do not fit, with the fitted ones.

    The intrinsics of one camera after the other are freed. F is the decrease of all cameras' sum of
    squares per parameter, divided by the remaining variance. It is near 1 if the given ones are
    right; if the model describes all lenses or boards only roughly, it is higher for all cameras.
    """
    found: dict[int, Camera] = {}
    while len(found) < len(views) // 2:
        ratios, fitted = _free_intrinsics(scene, target, sightings, views, tuple(found), config)
        worst = max(ratios, key=lambda view: ratios[view])
        usual = float(np.median([ratios[view] for view in ratios if view != worst] or [1.0]))
        count = sum(sighting.view == worst for sighting in sightings)
        if ratios[worst] < _limit_ratio(config, _PARAMETERS, count) * max(1.0, usual):
            break
        found[worst] = fitted[worst]
    return found


def _free_intrinsics(
    scene: CalibrationScene,
    target: Target,
    sightings: Sequence[Sighting],
    views: Sequence[int],
    before: tuple[int, ...],
    config: CalibrationConfig,
) -> tuple[dict[int, float], dict[int, Camera]]:
    """Return F of every camera and its fitted intrinsics; those of cameras `before` are free
    already."""
    held = () if target.known is not None else (views[0],)
    if before:
        scene = adjust_bundle(scene, target, sightings, FreeParameters(before, held), config)
    given = all_reprojection_errors(scene, target, sightings)
    ratios: dict[int, float] = {}
    fitted: dict[int, Camera] = {}
    for view in (view for view in views if view not in before):
        free = adjust_bundle(
            scene, target, sightings, FreeParameters((*before, view), held), config
        )
        left = all_reprojection_errors(free, target, sightings)
        near = np.maximum(given, left) < config.outlier
        fall = (given[near] ** 2).sum() - (left[near] ** 2).sum()
        ratios[view] = fall / _PARAMETERS / ((left[near] ** 2).mean() / 2)
        fitted[view] = free.cameras[view]
    return ratios, fitted

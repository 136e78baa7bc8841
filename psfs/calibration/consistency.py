"""Find the cameras that disagree with the others, and why.

Every comparison is a test of two variances (F test), of which sightings, not their points, are
independent, with one rate of false alarms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import scipy

from psfs.calibration.bundle import LENS_PARAMETERS, FreeParameters, adjust_bundle, compare_lenses
from psfs.calibration.scene import GOOD, CalibrationScene, reprojection_errors, rms
from psfs.calibration.targets.target import Sighting, Target, group_by_view
from psfs.cameras.camera import Camera
from psfs.common.numbers import FALSE_ALARMS, pick_evenly

#: Fewest cameras among which an outlier can be found.
_FEWEST = 3
#: Most sightings of a camera that are compared, and greatest delay that is tried, frames.
_SAMPLED, _MOST_LATE = 60, 5


def find_outlier_camera(
    scene: CalibrationScene, target: Target, sightings: Sequence[Sighting], views: Sequence[int]
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
    errors = [reprojection_errors(scene, target, groups[view]) for view in seen]
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


def explain_disagreement(
    scene: CalibrationScene, target: Target, sightings: Sequence[Sighting]
) -> str:
    """Explain why a camera disagrees: it was moved, is late, or its intrinsics are wrong.

    Returns how much it does and the reason that removes most of the error. scene: of the others,
    with this one where it fits best. sightings: its own.
    """
    every = [sightings[k] for k in pick_evenly(len(sightings), _SAMPLED)]
    error = rms(reprojection_errors(scene, target, every))
    guesses = [
        _test_moved(scene, target, every),
        _test_late(scene, target, every),
        _test_lens(scene, target, every),
    ]
    left, text = min(guesses)
    if error**2 < _limit_ratio(len(every), len(every)) * left**2:
        text = "it was moved, filmed something else, or its lens or focus changed"
    else:
        text = f"{text} ({left:.1f} px then)"
    return f"{error:.1f} px off what the others see; {text}"


def _fit_camera(
    scene: CalibrationScene,
    target: Target,
    sightings: Sequence[Sighting],
    lens: bool = False,
) -> tuple[np.ndarray, CalibrationScene]:
    """Fit one camera to its sightings; return its errors (N,) px and the scene.

    lens: fit its intrinsics too.
    """
    view = sightings[0].view
    held = tuple(other for other in range(len(scene.cameras)) if other != view)
    freedom = FreeParameters((view,) if lens else (), held, poses=False)
    scene = adjust_bundle(scene, target, sightings, freedom)
    return reprojection_errors(scene, target, sightings), scene


def _test_moved(
    scene: CalibrationScene, target: Target, sightings: list[Sighting]
) -> tuple[float, str]:
    best = np.inf, ""
    for share in np.linspace(0.1, 0.9, 9):
        at = round(share * len(sightings))
        parts = sightings[:at], sightings[at:]
        if min(len(part) for part in parts) < 3:
            continue
        (one, before), (two, after) = (_fit_camera(scene, target, part) for part in parts)
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
    scene: CalibrationScene, target: Target, sightings: list[Sighting]
) -> tuple[float, str]:
    best, most = (np.inf, ""), _MOST_LATE
    for late in (*range(-most, 0), *range(1, most + 1)):
        shifted = [replace(s, frame=s.frame - late * target.boards) for s in sightings]
        shifted = [s for s in shifted if s.frame in scene.poses]
        if len(shifted) >= max(4, len(sightings) // 2):
            left = rms(_fit_camera(scene, target, shifted)[0])
            if left < best[0]:
                word, name = "late" if late > 0 else "early", scene.cameras[sightings[0].view].name
                text = f"it comes {abs(late)} frames {word}: state --sync {name}={late}"
                best = left, f"{text}, or add {late} to its present lag"
    return best


def _test_lens(
    scene: CalibrationScene, target: Target, sightings: list[Sighting]
) -> tuple[float, str]:
    errors, fitted = _fit_camera(scene, target, sightings, lens=True)
    view = sightings[0].view
    return rms(errors), describe_lens_change(scene.cameras[view], fitted.cameras[view])


def describe_lens_change(stated: Camera, wanted: Camera) -> str:
    """Describe how a camera's pictures contradict its given intrinsics."""
    focal = wanted.K[0, 0] / stated.K[0, 0] - 1
    x, y = wanted.K[:2, 2] - stated.K[:2, 2]
    return (
        f"its intrinsics do not fit its pictures, which want a focal length of "
        f"{wanted.K[0, 0]:.0f} px ({100 * focal:+.1f} %) and a centre {x:+.0f}, {y:+.0f} px away"
    )


def find_wrong_intrinsics(
    scene: CalibrationScene, target: Target, sightings: Sequence[Sighting], views: Sequence[int]
) -> dict[int, Camera]:
    """Find the cameras among `views` whose given intrinsics do not fit, with the fitted ones.

    If the model describes all lenses or boards only roughly, F is higher than 1 for all cameras.
    """
    held = () if target.known is not None else (views[0],)
    tests = compare_lenses(scene, target, sightings, views, held)
    ratios = sorted(ratio for ratio, _ in tests.values())
    limit = _limit_ratio(LENS_PARAMETERS, len(sightings)) * max(
        1.0, float(np.median(ratios[:-1] or [1.0]))
    )
    return {view: camera for view, (ratio, camera) in tests.items() if ratio > limit}

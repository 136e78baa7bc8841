"""Which camera does not agree with the others, and why: each is left out in turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from psfs.calibration.bundle import Freedom, adjusted
from psfs.calibration.config import CalibrationConfig
from psfs.calibration.scene import Scene, all_errors, rms
from psfs.calibration.targets.target import Sighting, Target, by_frame
from psfs.cameras.camera import Camera

#: Cameras among which one can be told from the others, and frames in which it is tested.
_FEWEST, _MOST_FRAMES = 3, 80
#: Sightings of a camera by which reasons are tried.
_MOST_OWN = 50
#: Intrinsics of a camera, and the F of theirs beyond which given ones do not fit.
_PARAMETERS, _CERTAIN = 8, 6.0
#: Share of its errors that a reason must leave at most; frames by which a camera may be late.
_MENDED, _LATEST = 0.5, 5


@dataclass(frozen=True, eq=False)
class Trial:
    """A camera against the others. view: its number. scene: as the others alone have it, with the
    camera placed where it fits that best. sightings: its own, of what the others see. own, others:
    px root mean square of the errors in these and in the others' sightings."""

    view: int
    scene: Scene
    sightings: list[Sighting]
    own: float
    others: float


def trials(
    scene: Scene,
    target: Target,
    sightings: Sequence[Sighting],
    views: Sequence[int],
    config: CalibrationConfig,
) -> list[Trial]:
    """Return each of these cameras against the others of them, where there is anything to
    compare."""
    frames = sorted({sighting.frame for sighting in sightings})
    picked = {frames[k] for k in np.linspace(0, len(frames) - 1, _MOST_FRAMES).round().astype(int)}
    used = [s for s in sightings if s.frame in picked and s.view in views]
    found = [_trial(scene, target, used, view, views, config) for view in views]
    return [trial for trial in found if trial is not None]


def _trial(
    scene: Scene,
    target: Target,
    sightings: Sequence[Sighting],
    view: int,
    views: Sequence[int],
    config: CalibrationConfig,
) -> Trial | None:
    rest = [s for s in sightings if s.view != view]
    needed = 1 if target.known is not None else 2
    enough = {frame for frame, here in by_frame(rest).items() if len(here) >= needed}
    rest = [s for s in rest if s.frame in enough]
    own = [s for s in sightings if s.view == view and s.frame in enough]
    if len(own) < 4:
        return None
    count = len(scene.cameras)
    if target.known is None:
        anchor = next(other for other in views if other != view)
        away = tuple(v for v in range(count) if v not in views)
        scene = adjusted(scene, target, rest, Freedom(held=(anchor, view, *away)), config)
    held = tuple(other for other in range(count) if other != view)
    scene = adjusted(scene, target, own, Freedom(held=held, poses=False), config)
    left = all_errors(scene, target, own), all_errors(scene, target, rest)
    return Trial(view, scene, own, *map(rms, left))


def odd_one(found: Sequence[Trial], config: CalibrationConfig) -> Trial | None:
    """Return the camera that agrees with the others so much worse than they with each other as
    `config.inconsistent` says, None if all do as well."""
    if len(found) < _FEWEST:
        return None
    scores = np.array([trial.own / max(trial.others, 1e-9) for trial in found])
    worst = int(scores.argmax())
    usual = float(np.median(np.delete(scores, worst)))
    # A bad camera raises what the others alone are left with, too, but not what is left of itself.
    limit = config.inconsistent * max(1.0, min(usual, 1.5))
    return found[worst] if scores[worst] > limit and found[worst].own > config.noise else None


def reason(
    trial: Trial, target: Target, every: Sequence[Sighting], config: CalibrationConfig
) -> str:
    """Return why a camera disagrees: it was moved, it is late, its intrinsics are wrong; whatever
    would mend most of it. every: its sightings in all frames."""
    view, scene = trial.view, trial.scene
    every = [s for s in every if s.view == view and s.frame in scene.poses]
    picked = np.unique(np.linspace(0, len(every) - 1, _MOST_OWN).round().astype(int))
    every = [every[k] for k in picked]
    guesses = [
        _moved(scene, target, every, config),
        _late(scene, target, every, config),
        _other_lens(trial, target, config),
    ]
    left, text = min(guesses)
    if left > _MENDED * trial.own:
        return "it was moved, filmed something else, or its lens or focus changed"
    return f"{text} ({left:.1f} px then)"


def _fit(
    scene: Scene,
    target: Target,
    sightings: Sequence[Sighting],
    config: CalibrationConfig,
    lens: bool = False,
) -> tuple[np.ndarray, Scene]:
    """Return errors (N,) px of one camera's sightings, and the scene, once it stands, with `lens`
    also looks, as they want it."""
    view = sightings[0].view
    held = tuple(other for other in range(len(scene.cameras)) if other != view)
    freedom = Freedom((view,) if lens else (), held, poses=False)
    scene = adjusted(scene, target, sightings, freedom, config)
    return all_errors(scene, target, sightings), scene


def _moved(
    scene: Scene, target: Target, sightings: list[Sighting], config: CalibrationConfig
) -> tuple[float, str]:
    best = np.inf, ""
    for share in np.linspace(0.1, 0.9, 9):
        at = round(share * len(sightings))
        parts = sightings[:at], sightings[at:]
        if min(len(part) for part in parts) < 3:
            continue
        (one, before), (two, after) = (_fit(scene, target, part, config) for part in parts)
        left = rms(np.concatenate([one, two]))
        if left < best[0]:
            view = sightings[0].view
            away = np.linalg.norm(before.cameras[view].centre - after.cameras[view].centre)
            turn = before.cameras[view].R @ after.cameras[view].R.T
            angle = np.degrees(np.linalg.norm(cv2.Rodrigues(turn)[0]))
            text = f"it was moved near frame {parts[1][0].frame}, by {1000 * away:.0f} mm"
            best = left, f"{text} and {angle:.1f} degrees"
    return best


def _late(
    scene: Scene, target: Target, sightings: list[Sighting], config: CalibrationConfig
) -> tuple[float, str]:
    best = np.inf, ""
    for late in (*range(-_LATEST, 0), *range(1, _LATEST + 1)):
        shifted = [replace(s, frame=s.frame - late) for s in sightings]
        shifted = [s for s in shifted if s.frame in scene.poses]
        if len(shifted) >= max(4, len(sightings) // 2):
            left = rms(_fit(scene, target, shifted, config)[0])
            if left < best[0]:
                word = "late" if late > 0 else "early"
                best = left, f"it comes {abs(late)} frames {word}: state --sync CAMERA={late}"
    return best


def _other_lens(trial: Trial, target: Target, config: CalibrationConfig) -> tuple[float, str]:
    errors, fitted = _fit(trial.scene, target, trial.sightings, config, lens=True)
    wanted, given = (of.cameras[trial.view] for of in (fitted, trial.scene))
    return rms(errors), lens_change(given, wanted)


def lens_change(given: Camera, wanted: Camera) -> str:
    """Return in words what intrinsics a camera's pictures want instead of those given."""
    focal = wanted.K[0, 0] / given.K[0, 0] - 1
    x, y = wanted.K[:2, 2] - given.K[:2, 2]
    return (
        f"its intrinsics do not fit its pictures, which want a focal length of "
        f"{wanted.K[0, 0]:.0f} px ({100 * focal:+.1f} %) and a centre {x:+.0f}, {y:+.0f} px away"
    )


def lens_misfits(
    scene: Scene,
    target: Target,
    sightings: Sequence[Sighting],
    views: Sequence[int],
    config: CalibrationConfig,
) -> dict[int, Camera]:
    """Return those of `views` whose given intrinsics do not fit their pictures, as they should be.

    The intrinsics of one camera after the other are set free. F, the fall of all cameras' sum of
    squares per parameter over the variance that is left, is near 1 where those given are right;
    where lenses or boards are not quite what the model says, it is above that for all.
    """
    found: dict[int, Camera] = {}
    while len(found) < len(views) // 2:
        ratios, fitted = _freed(scene, target, sightings, views, tuple(found), config)
        worst = max(ratios, key=lambda view: ratios[view])
        usual = float(np.median([ratios[view] for view in ratios if view != worst] or [1.0]))
        if ratios[worst] < _CERTAIN * max(1.0, usual):
            break
        found[worst] = fitted[worst]
    return found


def _freed(
    scene: Scene,
    target: Target,
    sightings: Sequence[Sighting],
    views: Sequence[int],
    before: tuple[int, ...],
    config: CalibrationConfig,
) -> tuple[dict[int, float], dict[int, Camera]]:
    """Return F of every camera, and the camera with its intrinsics set free; those of the cameras
    `before` are free already."""
    held = () if target.known is not None else (views[0],)
    if before:
        scene = adjusted(scene, target, sightings, Freedom(before, held), config)
    given = all_errors(scene, target, sightings)
    ratios: dict[int, float] = {}
    fitted: dict[int, Camera] = {}
    for view in (view for view in views if view not in before):
        free = adjusted(scene, target, sightings, Freedom((*before, view), held), config)
        left = all_errors(free, target, sightings)
        near = np.maximum(given, left) < config.outlier
        fall = (given[near] ** 2).sum() - (left[near] ** 2).sum()
        ratios[view] = fall / _PARAMETERS / ((left[near] ** 2).mean() / 2)
        fitted[view] = free.cameras[view]
    return ratios, fitted

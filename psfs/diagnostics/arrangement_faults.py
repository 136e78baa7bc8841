"""Faults of what belongs together: exchanged, flipped and late pictures, cameras that disagree, and
calibrations of another convention. Each explanation is tried and measured by the silhouettes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import cv2
import numpy as np
import scipy

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.names import join_names
from psfs.common.numbers import jackknife
from psfs.diagnostics.agreement import leave_out
from psfs.diagnostics.config import SPECKLE_SHARE
from psfs.diagnostics.fault import Evidence, Fault, significant
from psfs.diagnostics.tangency import CAP, PairSums, Tangency

#: Conventions of other programs' calibrations: camera to world instead of world to camera; the
#: camera's centre instead of the translation; OpenGL's camera axes.
CONVENTIONS: dict[str, Callable[[Camera], Camera]] = {
    "R and t lead from the camera to the world": lambda c: replace(c, R=c.R.T, t=-c.R.T @ c.t),
    "t is the camera's centre": lambda c: replace(c, t=-c.R @ c.t),
    "the camera's axes are OpenGL's, y up and -z forward": lambda c: replace(
        c, R=np.diag([1.0, -1, -1]) @ c.R, t=np.diag([1.0, -1, -1]) @ c.t
    ),
}
#: Radial distortions k1 of wide lenses that are tried, and errors of the focal length that would
#: look alike.
_DISTORTIONS, _FOCAL_FACTORS = (-0.1, -0.2, -0.3, -0.4), (0.85, 0.9, 0.95, 1.05, 1.1)
#: Share of the misfit that an explanation must remove for certain: less is the silhouettes' noise.
_LEAST_GAIN = 0.15
#: Cameras, those that fit worst, of which any two may be exchanged.
_MOST_EXCHANGED = 8
#: Mean of the share of the silhouettes outside the others' hull and of the extreme planes' misfit,
#: as a share of the largest, above which no cameras agree.
_STRANGE = 0.6


@dataclass(frozen=True)
class _Trial:
    """An explanation of the misfit: the cameras that it changes, and the costs with it."""

    fault: Fault
    views: list[int]
    after: PairSums


def find_rearranged(evidence: Evidence) -> Iterator[Fault]:
    """Yield pictures that fit the cameras only exchanged or flipped, and calibrations that fit only
    in another convention or with another lens: the explanation that leaves the least misfit.

    Statistic: the share of the misfit of the changed cameras that the explanation removes, by
    stretches of frames; it must be above `_LEAST_GAIN` by a t test. If it changes all cameras, it
    must explain more than a single one that is wrong.
    """
    tangency = evidence.tangency
    before = tangency.unchanged
    if not math.isfinite(before.cost):
        return
    tried = [*_try_flips(evidence), *_try_conventions(evidence)]
    order = _find_order(evidence, before)
    if order != list(range(len(order))):
        tried.append(_describe_exchange(evidence.names, order, _compare_order(tangency, order)))
    elif not evidence.offsets.any():
        tried += _try_lenses(evidence)
    alone = min(before.without(v) for v in evidence.sound)
    fitting = [
        trial
        for trial in tried
        if significant(before.measure_gain(trial.after, trial.views), _LEAST_GAIN, len(tried))
        and not (len(trial.views) > 2 and trial.after.cost > (1 - _LEAST_GAIN) * alone)
    ]
    if fitting:
        yield min(fitting, key=lambda trial: trial.after.cost).fault


def _find_order(evidence: Evidence, before: PairSums) -> list[int]:
    """Return (V,) the camera whose pictures each camera should have: two cameras at a time are
    exchanged, the best pair first, as long as that surely helps."""
    tangency, order = evidence.tangency, list(range(len(evidence.names)))
    worst = np.argsort(-np.nan_to_num(before.cameras))[:_MOST_EXCHANGED]
    sizes = [camera.size for camera in evidence.rig]
    pairs = [(int(a), int(b)) for a, b in combinations(worst, 2) if sizes[a] == sizes[b]]
    for _ in range(len(order) - 1):
        best: tuple[list[int], PairSums] | None = None
        for a, b in pairs:
            swapped = list(order)
            swapped[a], swapped[b] = order[b], order[a]
            after = _compare_order(tangency, swapped)
            gain = before.measure_gain(after, (a, b))
            clear = significant(gain, _LEAST_GAIN, len(pairs))
            if clear and (best is None or after.cost < best[1].cost):
                best = swapped, after
        if best is None or not best[1].cost < before.cost:
            break
        order, before = best
    return order


def _compare_order(tangency: Tangency, order: list[int]) -> PairSums:
    """Return the differences if camera v has the pictures of camera order[v]."""
    return tangency.compare({v: tangency.see(v, o) for v, o in enumerate(order) if v != o})


def _describe_exchange(names: list[str], order: list[int], after: PairSums) -> _Trial:
    wrong = [view for view, image in enumerate(order) if view != image]
    if len(wrong) == 2:
        a, b = (names[view] for view in wrong)
        text = f"cameras {a} and {b} look exchanged: each one's pictures fit the other's place"
    else:
        moves = [f"those of {names[order[view]]} to {names[view]}" for view in wrong]
        text = f"cameras look exchanged; the pictures would fit so: {join_names(moves)}"
    cameras = tuple(names[view] for view in wrong)
    text = f"{text}; rename the files, or the calibration's cameras"
    return _Trial(Fault("exchange", cameras, text), wrong, after)


def _try_flips(evidence: Evidence) -> Iterator[_Trial]:
    """Yield the flips of all pictures or of one camera's. The flips of a symmetric body look alike,
    so they change no cost."""
    mirrored, turned = (-1, 1), (-1, -1)
    mends = {
        mirrored: "mirrored, left to right; flip them back",
        turned: "upside down; turn them, and the background, by 180 degrees",
    }
    views, tangency, names = evidence.sound, evidence.tangency, evidence.names
    single = [(signs, [view]) for view in views for signs in mends] if len(views) > 2 else []
    for signs, flipped in ((mirrored, views), *single):
        whose = f"camera {names[flipped[0]]}" if len(flipped) == 1 else "all cameras"
        text = f"the pictures of {whose} are {mends[signs]}"
        after = tangency.compare({view: tangency.see(view, view, signs) for view in flipped})
        cameras = tuple(names[view] for view in flipped)
        yield _Trial(Fault("flipped", cameras, text), flipped, after)


def _try_conventions(evidence: Evidence) -> Iterator[_Trial]:
    for meaning, mend in CONVENTIONS.items():
        cameras = tuple(mend(camera) for camera in evidence.rig)
        after = Tangency(CameraRig(cameras), evidence.tangency.outlines).unchanged
        if math.isfinite(after.cost):
            text = (
                f"the calibration fits only if {meaning}; write it as world to camera, x_cam = R x "
                "+ t"
            )
            yield _Trial(Fault("convention", (), text), evidence.sound, after)


def _try_lenses(evidence: Evidence) -> Iterator[_Trial]:
    """Yield the distortions that the calibration may lack, of all cameras or of one.

    If no camera has a distortion, those of wide lenses are tried for all at once, unless another
    focal length, which moves silhouettes alike, fits as well. If only some have none, the median
    of the others' is tried for each.
    """
    rig, views, names = evidence.rig, evidence.sound, evidence.names
    plain = [view for view, camera in enumerate(rig) if not camera.lens.any()]

    def compare(cameras: Iterable[Camera]) -> PairSums:
        return Tangency(CameraRig(tuple(cameras)), evidence.tangency.outlines).unchanged

    if len(plain) == len(rig):
        focal = [compare(c.refocused(factor) for c in rig) for factor in _FOCAL_FACTORS]
        refocused = min(focal, key=lambda sums: sums.cost)
        for k1 in _DISTORTIONS:
            after = compare(_bend(camera, [k1, 0, 0, 0, 0]) for camera in rig)
            gain = refocused.measure_gain(after, views)
            if significant(gain, _LEAST_GAIN, len(_DISTORTIONS)):
                text = (
                    f"the calibration states no lens distortion, but silhouettes fit with k1 = "
                    f"{k1:g}; write the lenses' distortion into the calibration"
                )
                yield _Trial(Fault("lens", (), text), views, after)
    elif 2 * len(plain) < len(rig):
        usual = np.median([camera.distortion for camera in rig if camera.lens.any()], axis=0)
        for view in plain:
            text = (
                f"camera {names[view]} has no lens distortion, and its silhouettes fit with that "
                f"of the other cameras (k1 = {usual[0]:.2g}); write its own into the calibration"
            )
            after = compare(_bend(c, usual) if v == view else c for v, c in enumerate(rig))
            yield _Trial(Fault("lens", (names[view],), text), [view], after)


def _bend(camera: Camera, distortion: object) -> Camera:
    return replace(camera, distortion=np.asarray(distortion, float))


def find_late(evidence: Evidence) -> Iterator[Fault]:
    """Yield a camera whose pictures come late or early.

    Statistic: the offset by `psfs.footage.camera_times`, see `Evidence.offsets`.
    """
    for view in np.flatnonzero(evidence.offsets):
        name, by = evidence.names[view], int(evidence.offsets[view])
        text = (
            f"camera {name} comes about {abs(by)} frames {'late' if by > 0 else 'early'} "
            f"({abs(by) / evidence.sequence.fps:.2g} s, to "
            f"{evidence.times.sigmas[view]:.1f} frames); --sync auto shifts it"
        )
        yield Fault("late", (name,), text, by)


def find_disagreeing(evidence: Evidence) -> Iterator[Fault]:
    """Yield cameras whose silhouettes do not fit those of the others.

    Statistic: by how much the share of the others' silhouettes that lies outside their common hull
    falls if the camera is left out, by frames; it must surely fall to less than half. Needs four
    cameras; at most a third of them are accused. If no camera explains it, and the silhouettes lie
    outside the hull and their extreme planes differ as those of strangers do, or most are poor,
    none agree.
    """
    views = evidence.sound
    while True:
        outside = evidence.agreement.measure(views)
        number, gains = find_outlier(outside)
        most = len(evidence.names) // 3
        accused = len(evidence.sound) - len(views)
        if len(views) < 4 or accused >= most or not significant(gains, math.log(2)):
            break
        yield _accuse(evidence, views[number], leave_out(outside, number))
        views = [view for view in views if view != views[number]]
    rows = np.diagonal(outside, axis1=1, axis2=2)
    rows = rows[np.isfinite(rows).any(axis=1)]
    beside = np.nanmedian(rows, axis=1)
    misfit = evidence.tangency.unchanged.cost / CAP
    strange = beside if math.isnan(misfit) else 0.5 * (beside + misfit)
    poor = _find_poor_silhouettes(evidence)
    if len(rows) and (2 * len(poor) > len(views) or significant(strange, _STRANGE)):
        yield _explain_disagreement(evidence, poor, float(np.mean(beside)), float(np.mean(strange)))


def find_outlier(outside: np.ndarray) -> tuple[int, np.ndarray]:
    """Return the camera without which the others agree best, and the logarithms (S,) by how much
    better than with it in each frame, see `jackknife`. outside: see `HullAgreement.measure`.

    What the camera itself shows outside the hull of the others counts, if it is less: a camera
    before which furniture stands only lacks what the others show, and one that shows nobody in a
    frame tells nothing there.
    """
    without = np.stack([leave_out(outside, view)[1] for view in range(outside.shape[1])], -1)
    known = np.isfinite(without).all(axis=1)
    if not known.any():
        return 0, np.zeros(0)
    view = int(without[known].mean(0).argmin())
    beside, speckle = np.nan_to_num(outside[:, view, view]), np.full(len(outside), SPECKLE_SHARE)
    rows = np.column_stack([leave_out(outside, view)[0], beside, without[:, view], speckle])[known]
    return view, jackknife(rows, lambda of: math.log((min(of[0], of[1]) + of[3]) / (of[2] + of[3])))


def _accuse(evidence: Evidence, view: int, shares: tuple[np.ndarray, np.ndarray]) -> Fault:
    """Return the fault of a camera; shares: of the others', see `leave_out`."""
    name, (before, after) = evidence.names[view], map(float, map(np.nanmean, shares))
    text = (
        f"camera {name} disagrees with the others: with it {before:.0%} of their silhouettes lie "
        f"outside the common hull, without it {after:.0%}"
    )
    if evidence.find_cause([name]) is None:
        text = f"{text}; {_explain_outlier(evidence, view)}"
    return Fault("disagrees", (name,), text, spoils=True)


def _explain_outlier(evidence: Evidence, view: int) -> str:
    """Return why a camera may disagree: the turn that makes it fit, if there is one."""
    tangency = evidence.tangency

    def turn(vector: np.ndarray) -> PairSums:
        return tangency.compare({view: tangency.turn(view, cv2.Rodrigues(vector)[0])})

    if math.isfinite(tangency.unchanged.cameras[view]):
        simplex = np.vstack([np.zeros(3), 0.05 * np.eye(3)])
        optimum = scipy.optimize.minimize(
            lambda vector: turn(vector).cameras[view],
            np.zeros(3),
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "maxfev": 200, "xatol": 1e-3, "fatol": 1e-4},
        )
        angle = float(np.linalg.norm(optimum.x))
        gain = tangency.unchanged.measure_gain(turn(optimum.x), [view])
        if angle < 0.5 and significant(gain, 0.5):
            return (
                f"it was turned by about {math.degrees(angle):.1f} degrees since its calibration, "
                "or that is wrong; calibrate it again"
            )
    return (
        "it was moved, its video is of another take or another person, or its silhouettes are "
        f"wrong; look: psfs silhouettes {evidence.sequence.folder} -o silhouettes"
    )


def _explain_disagreement(
    evidence: Evidence, poor: list[str], beside: float, strange: float
) -> Fault:
    if poor:
        text = f"the cameras do not agree, and silhouettes are poor: {join_names(poor)}"
    else:
        text = (
            f"the cameras do not agree: {beside:.0%} of their silhouettes lie outside the others' "
            f"hull, {strange:.0%} in the mean with the misfit of their edges, expected less than "
            f"{_STRANGE:.0%}, though each looks sound: the "
            "calibration is not of these pictures, or they are not of one time"
        )
    text = f"{text}; look at them: psfs info {evidence.sequence.folder} --masks FILE.png"
    return Fault("disagrees", (), text)


def _find_poor_silhouettes(evidence: Evidence) -> list[str]:
    """Return texts that name the cameras whose silhouettes are no single shape of steady size."""
    poor = []
    for view, camera in enumerate(evidence.rig):
        pixels = camera.size[0] * camera.size[1]
        outlines = [row[view] for row in evidence.views.outlines]
        areas = np.array([0 if outline is None else outline.area for outline in outlines])
        shares = areas / np.maximum(evidence.views.foreground[:, view] * pixels, 1)
        if (areas > 0).mean() < 0.5:
            poor.append(f"{camera.name} often shows no person")
        elif np.median(shares[areas > 0]) < 0.5:
            poor.append(f"{camera.name}'s are in pieces")
    return poor

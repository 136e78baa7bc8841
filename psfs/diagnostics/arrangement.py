"""Explanations of silhouettes that do not fit: pictures of two cameras are exchanged, late or
mirrored, a camera was turned, or the calibration has another convention. Each is tried and
measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from typing import Literal

import cv2
import numpy as np
from scipy.optimize import minimize

from psfs.cameras.camera import Camera, CameraRig
from psfs.diagnostics.config import FaultConfig
from psfs.diagnostics.small_views import Outline
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


def find_swapped_cameras(tangency: Tangency, config: FaultConfig) -> list[int]:
    """Return (V,) the camera whose pictures each camera should have.

    Two cameras at a time are exchanged, the best pair first, as long as that lowers the cost below
    `exchange_share` of what it was.
    """

    def alike(a: int, b: int) -> bool:
        return tangency.rig[a].size == tangency.rig[b].size

    order = list(range(len(tangency.rig)))
    present = tangency.compare(order)
    for _ in range(len(order) - 1):
        limit = config.exchange_share * present.cost
        pairs = [
            pair
            for pair in combinations(range(len(order)), 2)
            if alike(*pair) and _least_cost(tangency, present, pair) < limit
        ]
        tried = {pair: tangency.compare(_swap(order, *pair)) for pair in pairs}
        known = {pair: sums for pair, sums in tried.items() if np.isfinite(sums.cost)}
        if not known:
            break
        best = min(known, key=lambda pair: known[pair].cost)
        if not known[best].cost < limit:
            break
        order, present = _swap(order, *best), known[best]
    return order


def _least_cost(tangency: Tangency, present: PairSums, pair: tuple[int, int]) -> float:
    """Return the least cost that any other pictures of two cameras could give: of a hundred
    cameras that agree, no pair needs to be tried."""
    rest = np.delete(np.arange(len(tangency.rig)), pair)
    sums, counts = (of[np.ix_(rest, rest)].sum() for of in (present.sums, present.counts))
    most = 2 * tangency.n_frames * (len(tangency.rig) ** 2 - len(rest) ** 2)
    return float(sums / (counts + most))


def _swap(order: list[int], a: int, b: int) -> list[int]:
    swapped = list(order)
    swapped[a], swapped[b] = order[b], order[a]
    return swapped


#: Wrong orientations of pictures: left to right, or upside down.
Way = Literal["mirrored", "turned"]


#: Least fall of a camera's cost if its pictures are flipped: of a symmetric body's, both are noise.
_FLIP_GAIN = 0.01


def find_flipped_cameras(
    tangency: Tangency, config: FaultConfig
) -> tuple[Way, list[int], float] | None:
    """Return the orientation in which pictures fit, if they fit only mirrored or upside down.

    With it come the cameras that it applies to, all or one, and the cost that is left. A single
    camera is judged by its own pairs, since the others' cost hides how well it fits.
    """
    views, present = list(range(len(tangency.rig))), tangency.compare()
    every = tangency.compare(mirrored=views).cost
    if every < config.mirror_share * present.cost:
        return "mirrored", views, every
    ways: tuple[Way, ...] = ("mirrored", "turned")
    tried: dict[tuple[Way, int], tuple[float, float]] = {}
    for way in ways:
        for view in views if len(views) > 2 else ():
            found = tangency.compare(**{way: [view]}, base=present)
            if present.cameras[view] - found.cameras[view] > _FLIP_GAIN:
                tried[way, view] = found.cameras[view] / present.cameras[view], found.cost
    known = {flip: of for flip, of in tried.items() if np.isfinite(of).all()}
    if not known:
        return None
    way, view = best = min(known, key=lambda flip: known[flip])
    return (way, [view], known[best][1]) if known[best][0] < config.flip_share else None


#: Differences of costs up to this are noise: silhouettes of a person who keeps still agree at any
#: lag.
_NOISE = 0.003
#: Frames on either side of a lag that `refine_lags` tries, and its cap of the differences.
_NEAR, _FINE_CAP = 2, 0.01


class Lags:
    """Costs of all pairs of cameras at lags from -`most` to `most` frames.

    For each pair there are two costs: of the differences, and of the differences less the part that
    is the same in all frames. The one with the lower minimum is used, since calibrations err by a
    steady amount and silhouettes do not. cap: see `Tangency.differences`.
    """

    def __init__(self, tangency: Tangency, most: int, cap: float = CAP) -> None:
        n = len(tangency.rig)
        self.most, self.n_views = most, n
        self._table = np.zeros((n, n, 4 * most + 1, 2))
        for a, b in combinations(range(n), 2):
            first, second = tangency.planes(a, a, b), tangency.planes(b, b, a)
            if not tangency.comparable(a, b):
                continue
            ways = [
                tangency.differences(first, second, 2 * most, steady, cap)
                for steady in (True, False)
            ]
            pair = min(ways, key=lambda way: float(np.nanmin(_costs(way), initial=np.inf)))
            self._table[a, b], self._table[b, a] = pair, pair[::-1]

    def curve(self, view: int, shifts: list[int]) -> np.ndarray:
        """Return (2 most + 1,) the cost of a camera's pairs at each lag.

        Lags are -most to most frames by which its pictures come later than the others', which have
        `shifts`. NaN where too few frames are left.
        """
        sums = np.zeros((2 * self.most + 1, 2))
        for other in range(self.n_views):
            start = self.most - shifts[other]  # lag = shift of `view` - shift of `other`
            if other != view:
                sums += self._table[other, view, start : start + len(sums)]
        return _costs(sums)


def _costs(sums: np.ndarray) -> np.ndarray:
    """Return the means (L,) from sums and counts (L, 2); NaN where too few frames are left."""
    enough = sums[:, 1] > 0.4 * sums[:, 1].max(initial=1)
    return np.where(enough, sums[:, 0] / np.maximum(sums[:, 1], 1), np.nan)


def measure_lags(tangency: Tangency, most: int, config: FaultConfig) -> list[int]:
    """Return (V,) by how many frames the pictures of each camera come later than the others'.

    In each step the camera that gains most by a shift is shifted. A shift counts if the cost
    without it is `lag_gain` times as high and it is at least `least_lag` frames.
    """
    shifts = [0] * len(tangency.rig)
    if most < 1 or not np.isfinite(tangency.size):
        return shifts
    lags = Lags(tangency, most)
    for _ in range(3 * len(shifts)):
        gains, best = [], []
        for view in range(len(shifts)):
            curve = lags.curve(view, shifts)
            if not np.isfinite(curve[most + shifts[view]]):
                gains.append(1.0)
                best.append(shifts[view])
                continue
            best.append(int(np.nanargmin(curve)) - most)
            if abs(best[-1]) == most:  # the minimum is not within the lags: no lag is known
                gains.append(1.0)
                continue
            here, least = curve[most + shifts[view]], float(np.nanmin(curve))
            clear = here - least > _NOISE
            gains.append((here + _NOISE) / (least + _NOISE) if clear else 1.0)
        far = [
            gain if abs(to - shift) >= config.least_lag or shift else 1.0
            for gain, to, shift in zip(gains, best, shifts, strict=True)
        ]
        view = len(far) - 1 - int(np.argmax(far[::-1]))  # of two equal ones, the second
        threshold = config.lag_gain if not shifts[view] else 1.0 + 1e-6
        if far[view] <= threshold or best[view] == shifts[view]:
            break
        shifts[view] = best[view]
    middle = int(np.median(shifts))
    return [shift - middle for shift in shifts]


def refine_lags(tangency: Tangency, shifts: list[int]) -> list[int]:
    """Return `shifts` refined with larger pictures: each within two frames of what it was, at the
    minimum of the parabola through the best lag and its two neighbours.

    Only frames that nearly agree count: the others show that a lag is wrong, but not by how much.
    """
    most = max(abs(shift) for shift in shifts) + _NEAR + 1
    lags, found = Lags(tangency, most, _FINE_CAP), list(shifts)
    for view, shift in enumerate(shifts):
        if not shift:
            continue
        curve = lags.curve(view, shifts)
        near = curve[most + shift - _NEAR : most + shift + _NEAR + 1]
        if np.isfinite(near).all():
            best = most + shift - _NEAR + int(near.argmin())
            before, here, after = curve[best - 1 : best + 2]
            bend = before - 2 * here + after
            aside = 0.5 * (before - after) / bend if bend > 0 else 0.0
            found[view] = round(best - most + float(np.clip(aside, -1, 1)))
    return found


def measure_turn(tangency: Tangency, view: int) -> tuple[float, float]:
    """Return the angle, rad, by which to turn a camera about its centre so that its pictures fit
    the others' best, and its cost then as a share of the present one."""
    before = tangency.measure_turned(view, np.eye(3))
    found = minimize(
        lambda vector: tangency.measure_turned(view, cv2.Rodrigues(vector)[0]),
        np.zeros(3),
        method="Nelder-Mead",
        options={
            "initial_simplex": np.vstack([np.zeros(3), 0.05 * np.eye(3)]),
            "maxfev": 200,
            "xatol": 1e-3,
            "fatol": 1e-4,
        },
    )
    return float(np.linalg.norm(found.x)), float(found.fun / max(before, 1e-9))


def find_convention(
    rig: CameraRig, outlines: list[list[Outline | None]], cost: float, config: FaultConfig
) -> str | None:
    """Return the name in `CONVENTIONS` by which the calibration fits the pictures; None if none
    does."""
    costs = {}
    for name, mended in CONVENTIONS.items():
        tried = Tangency(CameraRig(tuple(mended(camera) for camera in rig)), outlines)
        costs[name] = tried.compare().cost
    known = {name: value for name, value in costs.items() if np.isfinite(value)}
    best = min(known, key=lambda name: known[name], default=None)
    return best if best is not None and known[best] < config.mirror_share * cost else None

"""Adjustment of all cameras and their times to the silhouettes of one person.

Robust least squares over epipolar residuals (see `psfs.diagnostics.refinement`): first of the
outermost planes that touch the silhouettes, which need no matching and so bear errors of many
degrees and frames, then of all frontier points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.rig_geometry import intersect_axes_ahead
from psfs.diagnostics.config import AlignmentConfig
from psfs.diagnostics.frontier import Contours, FrontierPoints, find_frontier_points
from psfs.diagnostics.refinement import Corrections, RigFit
from psfs.diagnostics.small_views import Outline
from psfs.self_calibration.hulls import HullRays

#: Least distance of the line between two cameras from the person, m.
_NEAREST = 0.4


@dataclass(frozen=True, eq=False)
class Adjusted:
    """An adjusted rig. lags: (V,) frame t of the first camera shows the time of frame
    t + lags[v] of camera v. last: the last step's corrections."""

    rig: CameraRig
    lags: np.ndarray
    last: Corrections


class Extremes:
    """The outermost tangent planes of the silhouettes of all cameras."""

    def __init__(self, cameras: Sequence[Camera], outlines: Sequence[Sequence[Outline | None]]):
        self.hulls = [HullRays(c, own) for c, own in zip(cameras, outlines, strict=True)]

    def find(
        self, cameras: Sequence[Camera], shifts: np.ndarray, every: int = 1
    ) -> FrontierPoints:
        """Return the points in which the outermost planes touch both silhouettes."""
        scene = intersect_axes_ahead(CameraRig(tuple(cameras)))
        found = []
        for a, b in combinations(range(len(cameras)), 2):
            line = cameras[b].centre - cameras[a].centre
            length = np.linalg.norm(line)
            if length < 1e-3:
                continue
            line = line / length
            ahead = scene - cameras[a].centre
            ahead = ahead - line * (ahead @ line)
            if np.linalg.norm(ahead) < _NEAREST:
                continue
            ahead /= np.linalg.norm(ahead)
            axes = np.stack([ahead, np.cross(line, ahead)], -1)
            sides = []
            for view in (a, b):
                hull = self.hulls[view]
                flat = hull.rays @ (cameras[view].R @ axes)
                angles = np.arctan2(flat[:, 1], flat[:, 0])
                values, points = hull.extreme_points(angles)
                sides.append((values, points, int(shifts[view])))
            found.append(_match(a, b, sides, every))
        if not found:
            return FrontierPoints(np.zeros((0, 2), int), np.zeros(0, int), np.zeros((0, 2, 2)), np.zeros(0))
        columns = zip(*[(p.views, p.frames, p.pixels, p.rates) for p in found], strict=True)
        return FrontierPoints(*(np.concatenate(column) for column in columns))


def _match(a, b, sides, every=1) -> FrontierPoints:
    (va, pa, sa), (vb, pb, sb) = sides
    first, end = max(-sa, -sb), min(len(va) - sa, len(vb) - sb)
    if end - first < 3:
        empty = np.zeros((0, 2), int), np.zeros(0, int), np.zeros((0, 2, 2)), np.zeros(0)
        return FrontierPoints(*empty)
    va, pa = va[first + sa : end + sa], pa[first + sa : end + sa]
    vb, pb = vb[first + sb : end + sb], pb[first + sb : end + sb]
    rate = 0.25 * ((va[2:] - va[:-2]) + (vb[2:] - vb[:-2]))
    good = np.isfinite(rate) & np.isfinite(va[1:-1]) & np.isfinite(vb[1:-1])
    good[(np.arange(len(good)) + first) % every != 0] = False
    frame, side = np.nonzero(good)
    pixels = np.stack([pa[1:-1][frame, side], pb[1:-1][frame, side]], 1)
    views = np.tile((a, b), (len(frame), 1))
    return FrontierPoints(views, frame + first + 1, pixels, rate[frame, side])


def adjust_extremes(
    rig: CameraRig, lags: np.ndarray, extremes: Extremes, config: AlignmentConfig, rounds: int, every=1
) -> Adjusted | None:
    return _adjust(rig, lags, lambda r, shifts, gate: extremes.find(r, shifts, every), config, rounds)


def adjust_frontier(
    rig: CameraRig, lags: np.ndarray, contours: Sequence[Contours], config: AlignmentConfig, gates
) -> Adjusted | None:
    def find(cameras, shifts, gate):
        own = []
        for contour, shift in zip(contours, shifts, strict=True):
            moved = object.__new__(Contours)
            vars(moved).update(vars(contour))
            moved.frames = contour.frames - shift
            own.append(moved)
        scene = intersect_axes_ahead(CameraRig(tuple(cameras)))
        return find_frontier_points(cameras, own, scene, gate)

    return _adjust(rig, lags, find, config, len(gates), gates)


def _adjust(rig, lags, find, config, rounds, gates=None) -> Adjusted | None:
    found = None
    for k in range(rounds):
        shifts = np.round(lags).astype(int)
        gate = gates[k] if gates is not None else config.gate
        fit = RigFit(rig, [], config.replace(gate=gate), lambda r, g: find(r, shifts, g))
        start = np.zeros((len(rig), 8))
        start[:, 7] = shifts - lags
        found = fit.solve(start=start, rounds=1)
        if found is None:
            return None
        rig = found.apply(rig)
        lags = shifts - found.offsets
        lags = lags - lags[0]
    return Adjusted(rig, lags, found)

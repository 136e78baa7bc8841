"""Up and the person's places from one camera's silhouettes of somebody upright.

A person who stands or walks is a vertical line of constant length, whose ends are seen: head and
feet. With the focal length known, this tells the camera's tilt, roll and height over the floor, in
units of the person's stature, and where the person is in every frame (Lv, Zhao & Nevatia, PAMI 28,
2006).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from psfs.cameras.camera import Camera
from psfs.diagnostics.hulls import HullRays
from psfs.diagnostics.small_views import Outline
from psfs.footage.camera_times import INDEPENDENT_SHARE

#: Shares of the person's apparent height that count as head and as feet.
_HEAD, _FEET = 0.12, 0.2
#: Standard deviations of the head's elevation and of its azimuth from the feet's, rad.
_ELEVATION, _AZIMUTH = 0.02, 0.04
#: Cameras' usual tilt, rad upwards, and height, statures, with their standard deviations, and that
#: of roll, rad.
_TILT, _HEIGHT, _ROLL = (-0.1, 0.5), (0.9, 0.35), 0.06
#: Fewest frames, or points in these, by which one or two cameras are judged.
FEWEST = 20


@dataclass(frozen=True, eq=False)
class UprightView:
    """One camera's view of somebody upright.

    hulls: of the silhouettes. axes: (3, 3) rows: right, forward and up in the camera's axes.
    height: of the camera over the floor, statures. places: (F, 2) the person's places right and
    forward of the camera, statures; NaN where the person is not wholly seen.
    """

    hulls: HullRays
    axes: np.ndarray
    height: float
    places: np.ndarray

    @cached_property
    def rays(self) -> np.ndarray:
        """The rays (N, 3) of the hulls in the floor's axes."""
        return self.hulls.rays @ self.axes.T


def floor_axes(tilt: float, roll: float) -> np.ndarray:
    """Return the axes (3, 3), rows right, forward, up, of a camera that looks up by `tilt` and
    whose right side is up by `roll`, rad."""
    up = np.array([np.sin(roll), -np.cos(roll) * np.cos(tilt), np.cos(roll) * np.sin(tilt)])
    right = np.cross([0, 0, 1.0], up)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(up, right), up])


def fit_upright(camera: Camera, outlines: Sequence[Outline | None]) -> UprightView | None:
    """Fit a camera's tilt, roll and height to its outlines [frame]; None if too few frames show the
    whole person."""
    hulls, ends = HullRays(camera, outlines), HullRays(camera, _join_contours(outlines))
    values = np.array([_TILT[0], 0.0, _HEIGHT[0]])
    for _ in range(2):
        seen = _measure(hulls, ends, floor_axes(values[0], values[1]))
        if np.isfinite(seen).all(axis=1).sum() < FEWEST:
            return None
        optimum = scipy.optimize.minimize(
            lambda x: _cost(hulls, ends, x),
            values,
            method="Nelder-Mead",
            options={
                "initial_simplex": values + np.vstack([np.zeros(3), np.diag([0.1, 0.05, 0.2])]),
                "xatol": 1e-3,
                "fatol": 1e-3,
                "maxfev": 120,
            },
        )
        values = optimum.x
    axes = floor_axes(values[0], values[1])
    top, bottom, head, feet = _measure(hulls, ends, axes).T
    a, b = np.tan(top), np.tan(-bottom)
    distance = 1 / np.maximum(a + b, 1e-3)
    azimuth = 0.5 * (head + feet)
    places = distance[:, None] * np.stack([np.sin(azimuth), np.cos(azimuth)], -1)
    return UprightView(hulls, axes, float(np.nanmedian(b * distance)), places)


def _cost(hulls: HullRays, ends: HullRays, x: np.ndarray) -> float:
    """Return the robust sum of squares of the misfits and of the deviations from usual cameras."""
    top, bottom, head, feet = _measure(hulls, ends, floor_axes(x[0], x[1])).T
    b = np.tan(-bottom)
    predicted = np.arctan(b * (1 - x[2]) / max(x[2], 0.05))
    elevation = np.where(b > 0, top - predicted, np.nan)
    residuals = np.concatenate([elevation / _ELEVATION, (head - feet) / _AZIMUTH])
    robust = 2 * INDEPENDENT_SHARE * (np.sqrt(1 + residuals[np.isfinite(residuals)] ** 2) - 1).sum()
    prior = [
        (x[0] - _TILT[0]) / _TILT[1],
        x[1] / _ROLL,
        (x[2] - _HEIGHT[0]) / _HEIGHT[1],
    ]
    return float(robust + np.square(prior).sum())


def _join_contours(outlines: Sequence[Outline | None]) -> list[Outline | None]:
    """Return outlines whose corners are those of the hull and points of the contour, for the places
    of head and feet. The contour is the largest part's, and a collar may cut off the head; the hull
    has all parts."""
    return [
        outline
        and replace(
            outline,
            points=np.concatenate([outline.points, outline.contour[::4]]),
            at_border=np.concatenate([outline.at_border, outline.contour_at_border[::4]]),
        )
        for outline in outlines
    ]


def _find_middles(ends: HullRays, azimuth: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Return the middle (F,) of the azimuths (N,) of the points `inside` in every frame."""
    out = np.full(ends.n_frames, np.nan)
    low = np.minimum.reduceat(np.where(inside, azimuth, np.inf), ends.starts)
    high = np.maximum.reduceat(np.where(inside, azimuth, -np.inf), ends.starts)
    out[ends.frames] = 0.5 * (low + high)
    return out


def _measure(hulls: HullRays, ends: HullRays, axes: np.ndarray) -> np.ndarray:
    """Return elevations of top and bottom, azimuths of head and feet (F, 4), rad."""
    local = hulls.rays @ axes.T
    elevation = np.arctan2(local[:, 2], np.hypot(local[:, 0], local[:, 1]))
    bottom, top = hulls.extremes(elevation).T
    local_ends = ends.rays @ axes.T
    rise = np.arctan2(local_ends[:, 2], np.hypot(local_ends[:, 0], local_ends[:, 1]))
    share = (rise - bottom[ends.rows]) / (top - bottom)[ends.rows]
    azimuth = np.arctan2(local_ends[:, 0], local_ends[:, 1])
    with np.errstate(invalid="ignore"):
        head = _find_middles(ends, azimuth, share > 1 - _HEAD)
        feet = _find_middles(ends, azimuth, share < _FEET)
    out = np.stack([top, bottom, head, feet], -1)
    out[~np.isfinite(out).all(1)] = np.nan
    return out

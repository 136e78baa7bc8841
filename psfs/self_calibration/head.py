"""Middles of the head, which all cameras see, as measurements of the cameras.

Frontier points tell badly how cameras stand around somebody who stays in place. At a few distances
below its top the head's silhouette has a middle between its left and right edge. It is the
projection of nearly the same point from all sides, for heads are nearly as deep as wide. So middles
are points common to all cameras; their places are eliminated from the normal equations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from psfs.cameras.camera import Camera
from psfs.diagnostics.frontier import FrontierPoints, SilhouetteContours
from psfs.diagnostics.refinement import N_PARAMETERS, Measure
from psfs.self_calibration.config import HeadConfig

#: Widths of Geman & McClure's weights, in standard deviations of the residuals.
_REACH = 2.5


@dataclass(frozen=True, eq=False)
class _Middles:
    """Middles of the head in one camera's F pictures at K distances below the top.

    places: (F, K, 2) from the principal point, px of a picture without distortion; NaN where
    unknown. across: (F, 2) unit vector across the head.
    """

    places: np.ndarray
    across: np.ndarray


class HeadSections:
    """Measurements of the head's middles by V cameras of `lags` (V,) frames.

    cameras: small; they tell the distances. up: (3,) unit vector.
    """

    def __init__(
        self, cameras: Sequence[Camera], lags: np.ndarray, contours: Sequence[SilhouetteContours],
        up: np.ndarray, config: HeadConfig,
    ) -> None:  # fmt: skip
        self.config, self._up = config, up
        rays = [c.rays(own.points) for c, own in zip(cameras, contours, strict=True)]
        tops = [_find_tops(own, of, up) for own, of in zip(contours, rays, strict=True)]
        self._times = np.arange(
            int(np.floor(-lags.max())) - 1,
            int(np.ceil(max(len(t) - lag for t, lag in zip(tops, lags, strict=True)))) + 1,
        )
        seen = np.full((len(self._times), len(cameras), 3), np.nan)
        for view, (top, lag) in enumerate(zip(tops, lags, strict=True)):
            frames = np.round(self._times + lag).astype(int)
            known = (frames >= 0) & (frames < len(top))
            seen[known, view] = top[frames[known]]
        places = _intersect(seen, np.stack([camera.centre for camera in cameras]))
        self._waists = [_find_waists(own) for own in contours]
        self._middles = []
        for view, camera in enumerate(cameras):
            at = np.round(np.arange(len(tops[view])) - lags[view]).astype(int) - self._times[0]
            depths = (places[at] - camera.centre) @ camera.R[2]
            self._middles.append(
                self._measure_middles(camera, contours[view], rays[view], tops[view], depths)
            )

    def _measure_middles(
        self, camera: Camera, contours: SilhouetteContours, rays: np.ndarray, tops: np.ndarray,
        depths: np.ndarray,
    ) -> _Middles:  # fmt: skip
        """Return the head's middles below the rays to its tops (F, 3) at depths (F,) m."""
        focal, count = camera.K[0, 0], len(tops)
        local, vertical = tops @ camera.R.T, camera.R @ self._up
        top = focal * local[:, :2] / local[:, 2:]
        upward = vertical[:2] - top / focal * vertical[2]
        upward /= np.linalg.norm(upward, axis=1, keepdims=True)
        across = np.stack([-upward[:, 1], upward[:, 0]], -1)
        own, frames = rays @ camera.R.T, contours.frames
        away = focal * own[:, :2] / own[:, 2:] - top[frames]
        down, aside = -(away * upward[frames]).sum(axis=1), (away * across[frames]).sum(axis=1)
        places = np.full((count, len(self.config.below), 2), np.nan)
        sound = np.isfinite(depths)
        for number, below in enumerate(self.config.below):
            wanted = focal * below / depths
            near = np.abs(down - wanted[frames]) < self.config.band
            edges = _measure_edges(frames[near], aside[near], contours.at_border[near] > 0, count)
            width = (edges[:, 1] - edges[:, 0]) * depths / focal
            # Where an arm or the shoulders join the head, what is below does not count.
            narrow, wide = width <= self.config.narrowest, width >= self.config.widest
            sound &= ~(narrow | wide)
            middle = edges.mean(axis=1)[:, None]
            places[:, number] = top - wanted[:, None] * upward + middle * across
            places[~(sound & np.isfinite(width)), number] = np.nan
        return _Middles(places, across)

    def __call__(
        self, cameras: Sequence[Camera], lags: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the normal matrix (8 V, 8 V) and the gradient (8 V,) at cameras and lags (V,)."""
        size = len(cameras) * N_PARAMETERS
        places, rates, across, known = self._interpolate(lags)
        if not len(places):
            return np.zeros((size, size)), np.zeros(size)
        residuals, by_camera, by_place = self._differentiate(cameras, places, rates, across, known)
        noise = max(self.config.noise, 1.4826 * float(np.median(np.abs(residuals[known][:, 0]))))
        robust = 1 + (residuals[..., :1] / (_REACH * noise)) ** 2
        widths = noise * np.array([1, self.config.along]) * robust
        roots = np.sqrt(self.config.information) / widths * known[..., None]
        n, views = len(residuals), len(cameras)
        rows = np.zeros((n, views, 2, views, N_PARAMETERS))
        for view in range(views):
            rows[:, view, :, view] = roots[:, view, :, None] * by_camera[:, view]
        stacked = rows.reshape(n, 2 * views, size)
        points = (roots[..., None] * by_place).reshape(n, 2 * views, 3)
        values = (roots * residuals).reshape(n, 2 * views)
        flat = rows.reshape(-1, size)
        mixed = stacked.transpose(0, 2, 1) @ points
        own = points.transpose(0, 2, 1) @ points + 1e-9 * np.eye(3)
        solved = np.linalg.solve(own, mixed.transpose(0, 2, 1)).reshape(-1, size)
        moved = np.einsum("nki,nk->ni", points, values).reshape(-1)
        normal = flat.T @ flat - mixed.transpose(0, 2, 1).reshape(-1, size).T @ solved
        return normal, flat.T @ values.ravel() - solved.T @ moved

    def bind(self, shifts: np.ndarray) -> tuple[Measure, Callable[[FrontierPoints], np.ndarray]]:
        """Return the measurements and groups of frontier points in shifted frames, for `RigFit`."""
        return (
            lambda cameras, offsets: self(cameras, shifts - offsets),
            lambda points: self.group(points, shifts),
        )

    def group(self, points: FrontierPoints, shifts: np.ndarray) -> np.ndarray:
        """Return numbers (M,) of frontier points of shifted frames: apart by pair of cameras, and
        the person's upper and lower half, for shadows of the floor spoil the feet."""
        first, second = points.views.T
        low = np.zeros(len(points), int)
        for view, waists in enumerate(self._waists):
            mine = first == view
            heights = waists[points.frames[mine] + int(shifts[view])]
            low[mine] = points.pixels[mine, 0, 1] > heights
        numbers: np.ndarray = 2 * (first * len(self._waists) + second) + low
        return numbers

    def _interpolate(
        self, lags: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return middles (N, V, 2) px at common times, their rates, px per frame, directions across
        (N, V, 2) and whether each is known (N, V): those which three cameras or more see."""
        count, views = len(self.config.below), len(self._middles)
        places = np.full((len(self._times), count, views, 2), np.nan)
        rates, across = places.copy(), np.full((len(self._times), views, 2), np.nan)
        for view, own in enumerate(self._middles):
            frames = self._times + lags[view]
            whole = np.floor(frames).astype(int)
            inside = (whole >= 1) & (whole + 2 < len(own.places))
            at, share = whole[inside], (frames - whole)[inside, None, None]
            before, here, then, after = (own.places[at + k] for k in (-1, 0, 1, 2))
            places[inside, :, view] = (1 - share) * here + share * then
            rates[inside, :, view] = 0.5 * ((1 - share) * (then - before) + share * (after - here))
            across[inside, view] = own.across[at]
        known = np.isfinite(places[..., 0]) & np.isfinite(rates[..., 0])
        times, section = np.nonzero(known.sum(axis=-1) >= 3)
        known = known[times, section]
        fill = known[..., None]
        return (
            np.where(fill, places[times, section], 0.0),
            np.where(fill, rates[times, section], 0.0),
            np.where(fill, across[times], np.array([1.0, 0.0])),
            known,
        )

    def _differentiate(
        self, cameras: Sequence[Camera], places: np.ndarray, rates: np.ndarray, across: np.ndarray,
        known: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        """Return residuals (N, V, 2) px across and along the head, and their derivatives by the
        camera (N, V, 2, 8), as in `RigCorrections`, and by the point's place (N, V, 2, 3)."""
        R = np.stack([camera.R for camera in cameras])
        centres = np.stack([camera.centre for camera in cameras])
        focal = np.array([camera.K[0, 0] for camera in cameras])[:, None]
        rays = np.concatenate([places / focal, np.ones((*known.shape, 1))], -1)
        rays = np.where(known[..., None], np.einsum("vji,nvj->nvi", R, rays), np.nan)
        points = _intersect(rays, centres)
        axes = np.stack([across, np.stack([-across[..., 1], across[..., 0]], -1)], -2)
        weights = known[..., None] / np.array([1, self.config.along]) ** 2
        for _ in range(2):
            local = np.einsum("vij,nvj->nvi", R, points[:, None] - centres)
            seen = focal * local[..., :2] / local[..., 2:]
            slopes = np.zeros((*seen.shape, 3))
            slopes[..., 0, 0] = slopes[..., 1, 1] = focal[:, 0]
            slopes[..., 2] = -seen
            slopes = axes @ (slopes / local[..., 2, None, None])
            residuals = np.einsum("nvij,nvj->nvi", axes, seen - places)
            by_place = slopes @ R
            total = np.einsum("nvi,nvik,nvil->nkl", weights, by_place, by_place)
            pull = np.einsum("nvi,nvik,nvi->nk", weights, by_place, residuals)
            points = points - np.linalg.solve(total + 1e-9 * np.eye(3), pull[..., None])[..., 0]
        by_camera = np.empty((*residuals.shape, N_PARAMETERS))
        by_camera[..., :3] = np.cross(local[..., None, :], slopes)
        by_camera[..., 3:6] = -by_place
        by_camera[..., 6] = np.einsum("nvij,nvj->nvi", axes, seen)
        by_camera[..., 7] = np.einsum("nvij,nvj->nvi", axes, rates)
        return residuals, by_camera, by_place


def _find_tops(contours: SilhouetteContours, rays: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return the rays (F, 3) through the topmost points of the contours; NaN where unknown."""
    count = int(contours.frames.max(initial=-1)) + 1
    tops = np.full((count, 3), np.nan)
    heights = rays @ up / np.linalg.norm(rays, axis=1)
    order = np.lexsort((heights, contours.frames))
    last = np.nonzero(np.diff(contours.frames[order], append=-1))[0]
    at = order[last]
    at = at[contours.at_border[at] == 0]
    tops[contours.frames[at]] = rays[at]
    return tops


def _find_waists(contours: SilhouetteContours) -> np.ndarray:
    """Return the rows (F,) px halfway between top and bottom of the contours."""
    low, high = np.full((2, int(contours.frames.max(initial=-1)) + 1), np.nan)
    np.fmin.at(low, contours.frames, contours.points[:, 1])
    np.fmax.at(high, contours.frames, contours.points[:, 1])
    waists: np.ndarray = 0.5 * (low + high)
    return waists


def _intersect(rays: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Return the places (N, 3) nearest to the known ones of the rays (N, V, 3); NaN for one."""
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    known = np.isfinite(rays[..., 0])
    across = np.where(
        known[..., None, None], np.eye(3) - rays[..., :, None] * rays[..., None, :], 0.0
    )
    pulls = np.einsum("nvij,vj->ni", across, centres)
    found = np.linalg.solve(across.sum(axis=1) + 1e-9 * np.eye(3), pulls[..., None])[..., 0]
    return np.where(known.sum(axis=1)[:, None] >= 2, found, np.nan)


def _measure_edges(
    frames: np.ndarray, aside: np.ndarray, at_border: np.ndarray, count: int, ragged: float = 4.0
) -> np.ndarray:
    """Return the means (F, 2), px, of the left and the right contour points; NaN if either is
    missing, cut by the picture's border or spread over more than `ragged`, px."""
    lowest, highest = np.full(count, np.nan), np.full(count, np.nan)
    np.fmin.at(lowest, frames, aside)
    np.fmax.at(highest, frames, aside)
    middle = 0.5 * (lowest + highest)
    edges = np.full((count, 2), np.nan)
    cut = np.bincount(frames[at_border], minlength=count) > 0
    for side, own in enumerate((aside < middle[frames], aside >= middle[frames])):
        number = np.bincount(frames[own], minlength=count)
        total = np.bincount(frames[own], aside[own], minlength=count)
        inner = np.full(count, np.nan)
        (np.fmax if side == 0 else np.fmin).at(inner, frames[own], aside[own])
        spread = inner - lowest if side == 0 else highest - inner
        known = (number > 0) & (spread <= ragged) & ~cut
        edges[known, side] = total[known] / number[known]
    edges[~np.isfinite(edges).all(axis=1)] = np.nan
    return edges

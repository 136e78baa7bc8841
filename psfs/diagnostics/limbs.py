"""Points on the axes of limbs as measurements of the cameras.

Frontier points tell badly how cameras stand around somebody who stays in place, and silhouettes
that are too wide or too narrow move them. The medial axis of a limb does not move with the width.
A point of it in one camera is tried at all depths: where it is right, the others see an axis of
the same width. Each camera measures the point's distance across its axis; along the axis only
the first camera tells the place. The points are eliminated from the normal equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from psfs.cameras.camera import Camera
from psfs.common.least_squares import REACH
from psfs.common.progress import map_in_threads
from psfs.diagnostics.config import LimbConfig
from psfs.diagnostics.frontier import SilhouetteContours
from psfs.diagnostics.hulls import HullRays
from psfs.diagnostics.medial_axes import OPPOSITE, MedialAxes
from psfs.diagnostics.refinement import N_PARAMETERS, Measure
from psfs.diagnostics.sights import PersonPlace, Sight, find_person
from psfs.footage.camera_times import INDEPENDENT_SHARE

#: Widths of limbs, statures, and the greatest ratio of a limb's widths in two cameras.
_THINNEST, _WIDEST, _ALIKE = 0.018, 0.13, 1.4
#: Depths that are searched around the person's middle, their step, and the distance of another
#: depth from the best, statures.
_AROUND, _STEP, _APART = 0.75, 0.011, 0.07
#: Fewest cameras that see a point, and how many more must see it at the best depth than at another.
_VIEWS, _LEAD = 3, 0.5
#: Distance of a point from an axis up to which they agree, px, and greatest angle between a limb's
#: direction and the plane in which a camera sees it, rad.
_GATE, _STRAIGHT = 5.0, 0.35
#: Information of the place along the axis: it fixes the point and tells no camera anything.
_ALONG = 1e-2


@dataclass(frozen=True, eq=False)
class _Traced:
    """S points on limbs' axes and what V cameras tell of them.

    times: (S,) frames of the first camera. firsts: (S,) the cameras in which they were chosen.
    points: (S, 3). known: (S, V) bool. frames: (S, V) the picture before the time. across: (S, V,
    2) unit vectors across the axis. places: (S, V, 2, 2) on the axis in the pictures before and
    after, px from the principal point.
    """

    times: np.ndarray
    firsts: np.ndarray
    points: np.ndarray
    known: np.ndarray
    frames: np.ndarray
    across: np.ndarray
    places: np.ndarray

    def select(self, kept: np.ndarray) -> _Traced:
        return _Traced(*(getattr(self, field.name)[kept] for field in fields(self)))


@dataclass(frozen=True, eq=False)
class LimbViews:
    """Limbs' axes in the pictures of V cameras, and where these see the person."""

    axes: list[MedialAxes]
    sights: list[Sight]
    config: LimbConfig

    @classmethod
    def create(
        cls, hulls: Sequence[HullRays], contours: Sequence[SilhouetteContours], config: LimbConfig
    ) -> LimbViews:
        """Measure the axes in the contours of each view."""
        pairs = list(zip(hulls, contours, strict=True))
        axes = map_in_threads(lambda of: MedialAxes.create(of[0].camera, of[1]), pairs)
        return cls(list(axes), [Sight.create(own) for own in hulls], config)

    def find_points(self, cameras: Sequence[Camera], lags: np.ndarray) -> LimbPoints:
        """Return the points on axes on which cameras of these lags (V,) frames agree."""
        person = find_person(cameras, self.sights)
        return LimbPoints(cameras, lags, self.axes, person, self.config)


class LimbPoints:
    """Measurements by points on limbs' axes, found by V cameras of `lags` (V,) frames."""

    def __init__(
        self, cameras: Sequence[Camera], lags: np.ndarray, axes: Sequence[MedialAxes],
        person: PersonPlace, config: LimbConfig,
    ) -> None:  # fmt: skip
        self.config = config
        found = [
            _find_points(view, cameras, lags, axes, person, config) for view in range(len(cameras))
        ]
        self._traced = _trace(cameras, lags, axes, found)

    def __len__(self) -> int:
        return len(self._traced.times)

    def bind(self, shifts: np.ndarray) -> Measure:
        """Return the measurements in shifted frames, for `RigFit`."""
        return lambda cameras, offsets: self(cameras, shifts - offsets)

    def __call__(
        self, cameras: Sequence[Camera], lags: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the normal matrix (8 V, 8 V) and the gradient (8 V,) at cameras and lags (V,)."""
        size = len(cameras) * N_PARAMETERS
        if not len(self):
            return np.zeros((size, size)), np.zeros(size)
        residuals, by_camera, by_point, known = self._differentiate(cameras, lags)
        typical = float(np.median(np.abs(residuals[..., 0][self._traced.known])))
        noise = max(self.config.noise, 1.4826 * typical)
        robust = 1 + (residuals[..., :1] / (REACH * noise)) ** 2
        roots = np.sqrt(INDEPENDENT_SHARE * known) / (noise * robust)
        n, views = residuals.shape[:2]
        rows = np.zeros((n, views, 2, views, N_PARAMETERS))
        for view in range(views):
            rows[:, view, :, view] = roots[:, view, :, None] * by_camera[:, view]
        stacked = rows.reshape(n, 2 * views, size)
        points = (roots[..., None] * by_point).reshape(n, 2 * views, 3)
        values = (roots * residuals).reshape(n, 2 * views)
        flat = rows.reshape(-1, size)
        mixed = stacked.transpose(0, 2, 1) @ points
        own = points.transpose(0, 2, 1) @ points + 1e-9 * np.eye(3)
        solved = np.linalg.solve(own, mixed.transpose(0, 2, 1)).reshape(-1, size)
        moved = np.einsum("nki,nk->ni", points, values).reshape(-1)
        normal = flat.T @ flat - mixed.transpose(0, 2, 1).reshape(-1, size).T @ solved
        return normal, flat.T @ values.ravel() - solved.T @ moved

    def _differentiate(
        self, cameras: Sequence[Camera], lags: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return residuals (S, V, 2) px across and along the axes, their derivatives by the camera
        (S, V, 2, 8), as in `RigCorrections`, and by the point (S, V, 2, 3), and how much each
        counts (S, V, 2)."""
        traced = self._traced
        R, centres = np.stack([c.R for c in cameras]), np.stack([c.centre for c in cameras])
        focal = np.array([camera.K[0, 0] for camera in cameras])
        share = (traced.times[:, None] + lags - traced.frames)[..., None]
        before, after = traced.places[:, :, 0], traced.places[:, :, 1]
        places, rates = (1 - share) * before + share * after, after - before
        across = traced.across
        bases = np.stack([across, np.stack([-across[..., 1], across[..., 0]], -1)], -2)
        known = np.stack([traced.known, np.zeros(traced.known.shape)], -1)
        known[np.arange(len(known)), traced.firsts, 1] = _ALONG
        points = traced.points
        for _ in range(3):
            local = np.einsum("vij,nvj->nvi", R, points[:, None] - centres)
            seen = focal[:, None] * local[..., :2] / local[..., 2:]
            slopes = np.zeros((*seen.shape, 3))
            slopes[..., 0, 0] = slopes[..., 1, 1] = focal
            slopes[..., 2] = -seen
            slopes = bases @ (slopes / local[..., 2, None, None])
            residuals = np.einsum("nvij,nvj->nvi", bases, seen - places)
            by_point = slopes @ R
            total = np.einsum("nvi,nvik,nvil->nkl", known, by_point, by_point)
            pull = np.einsum("nvi,nvik,nvi->nk", known, by_point, residuals)
            points = points - np.linalg.solve(total + 1e-9 * np.eye(3), pull[..., None])[..., 0]
        by_camera = np.empty((*residuals.shape, N_PARAMETERS))
        by_camera[..., :3] = np.cross(local[..., None, :], slopes)
        by_camera[..., 3:6] = -by_point
        by_camera[..., 6] = np.einsum("nvij,nvj->nvi", bases, seen)
        by_camera[..., 7] = np.einsum("nvij,nvj->nvi", bases, rates)
        return residuals, by_camera, by_point, known


def _find_points(
    view: int, cameras: Sequence[Camera], lags: np.ndarray, axes: Sequence[MedialAxes],
    person: PersonPlace, config: LimbConfig,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return indices (N,) of a camera's medial points and the points (N, 3) in space at whose depth
    most other cameras see an axis of the same width."""
    camera, own = cameras[view], axes[view]
    if not np.isfinite(person.stature):  # nobody is seen wholly
        return np.zeros(0, int), np.zeros((0, 3))
    chosen = np.arange(0, len(own.frames), max(1, len(own.frames) // config.per_camera))
    middle = (person.middle - camera.centre) @ camera.R[2]
    around, step = _AROUND * person.stature, _STEP * person.stature
    depths = np.arange(max(step, middle - around), middle + around, step)
    if not len(chosen) or not len(depths):
        return np.zeros(0, int), np.zeros((0, 3))
    focal = camera.K[0, 0]
    rays = np.column_stack([own.places[chosen] / focal, np.ones(len(chosen))]) @ camera.R
    widths = own.widths[chosen][:, None] * depths / focal
    sound = (widths > _THINNEST * person.stature) & (widths < _WIDEST * person.stature)
    tried, widths = np.flatnonzero(sound), widths[sound]
    of_ray, of_depth = np.divmod(tried, len(depths))
    points = camera.centre + rays[of_ray] * depths[of_depth, None]
    costs = np.where(sound, 0.0, np.inf)
    votes = np.ones(costs.shape, int)
    for number, (other, seen) in enumerate(zip(cameras, axes, strict=True)):
        if number == view or not len(seen.frames):
            continue
        places, z = _project(other, points)
        frames = np.round(own.frames[chosen] - lags[view] + lags[number]).astype(int)
        nearest = seen.find_nearest(frames[of_ray], places)
        met = nearest >= 0
        nearest, places, z = nearest[met], places[met], z[met]
        away = ((places - seen.places[nearest]) * seen.across[nearest]).sum(-1) / _GATE
        agree = np.abs(away) < 1
        agree &= _are_alike(seen.widths[nearest] * z / other.K[0, 0], widths[met])
        costs.flat[tried[met]] -= np.where(agree, 1 - away**2, 0)
        votes.flat[tried[met]] += agree
    best, rows = costs.argmin(axis=1), np.arange(len(chosen))
    another = np.abs(depths - depths[best][:, None]) > _APART * person.stature
    lead = np.where(another, costs, 0).min(axis=1) - costs[rows, best]
    kept = np.isfinite(costs[rows, best]) & (votes[rows, best] >= _VIEWS)
    kept &= lead > _LEAD
    return chosen[kept], camera.centre + rays[kept] * depths[best[kept], None]


def _project(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the places (..., 2), px from the principal point without distortion, and depths (...)
    of points (..., 3)."""
    local = (points - camera.centre) @ camera.R.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return camera.K[0, 0] * local[..., :2] / local[..., 2:], local[..., 2]


def _are_alike(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return (first < _ALIKE * second) & (second < _ALIKE * first)


def _trace(
    cameras: Sequence[Camera], lags: np.ndarray, axes: Sequence[MedialAxes],
    found: Sequence[tuple[np.ndarray, np.ndarray]],
) -> _Traced:  # fmt: skip
    """Return what all cameras measure of the points that were found from each of them."""
    firsts = np.repeat(np.arange(len(found)), [len(own) for own, _ in found])
    indices, points = (np.concatenate(of) for of in zip(*found, strict=True))
    n, views = len(points), len(cameras)
    times, widths = np.zeros(n), np.zeros(n)
    for view, (camera, own) in enumerate(zip(cameras, axes, strict=True)):
        mine = firsts == view
        times[mine] = own.frames[indices[mine]] - lags[view]
        depths = (points[mine] - camera.centre) @ camera.R[2]
        widths[mine] = own.widths[indices[mine]] * depths / camera.K[0, 0]
    known, frames = np.zeros((n, views), bool), np.zeros((n, views), int)
    across, places = np.zeros((n, views, 2)), np.zeros((n, views, 2, 2))
    planes = np.zeros((n, views, 3))
    for view, (camera, own) in enumerate(zip(cameras, axes, strict=True)):
        if not len(own.frames):
            continue
        mine, at = firsts == view, times + lags[view]
        frames[:, view] = np.where(mine, np.round(at), np.floor(at))
        seen, z = _project(camera, points)
        pair = [own.find_nearest(frames[:, view] + later, seen) for later in (0, 1)]
        pair[0] = np.where(mine, indices, pair[0])
        normals = [own.across[nearest] for nearest in pair]
        cosines = (normals[0] * normals[1]).sum(1)
        normals[1] = normals[1] * np.sign(cosines)[:, None]
        sound = np.abs(cosines) > OPPOSITE
        mean = normals[0] + normals[1]
        mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9)
        for later, (nearest, normal) in enumerate(zip(pair, normals, strict=True)):
            away = ((seen - own.places[nearest]) * normal).sum(1)
            sound &= (nearest >= 0) & (np.abs(away) < (2 + later) * _GATE)
            sound &= _are_alike(own.widths[nearest] * z / camera.K[0, 0], widths)
            places[:, view, later] = seen - away[:, None] * mean
        known[:, view], across[:, view] = sound, mean
        plane = np.column_stack([camera.K[0, 0] * mean, -(mean * seen).sum(1)]) @ camera.R
        planes[:, view] = plane / np.linalg.norm(plane, axis=1, keepdims=True)
    # The limb lies in the plane in which each camera sees it.
    spread = np.einsum("nvi,nvj,nv->nij", planes, planes, known)
    directions = np.linalg.eigh(spread)[1][:, :, 0]
    known &= np.abs(np.einsum("nvi,ni->nv", planes, directions)) < np.sin(_STRAIGHT)
    kept = (known.sum(axis=1) >= _VIEWS) & known[np.arange(n), firsts]
    return _Traced(times, firsts, points, known, frames, across, places).select(kept)

"""Frontier points of the silhouettes of two cameras, and their epipolar residuals.

Where a plane through two camera centres touches a body, both cameras see the body's rim at the same
point, a frontier point: there both contours touch corresponding epipolar lines (Cipolla & Giblin,
Visual motion of curves and surfaces, 2000; Sinha & Pollefeys, IJCV 87, 2010). Every tip of a limb
gives some. They are found as the contours' local extremes of the angle around the line between the
two cameras, and matched by this angle.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import scipy

from psfs.cameras.camera import Camera
from psfs.cameras.rig_geometry import look_along_baseline
from psfs.common.progress import map_in_threads
from psfs.diagnostics.small_views import Outline

#: Points of a contour on either side of a tip that must lie behind it, px.
_SIDE = 12
#: Farthest way of a tip from frame to frame, px.
_REACH = 20.0
#: Greatest tangent of the angle between a contour's ray and the direction to the scene, around the
#: line between two cameras: the planes of the rest are not compared.
_STEEPEST = 3.0
#: Least distance of the line between two cameras from the scene, m.
NEAREST = 0.5
#: Greatest change of a tip's speed from frame to frame, and difference between two cameras, px per
#: frame: with half of it half as many tips count, and few fast ones.
BEND = 2.0


class SilhouetteContours:
    """The contours of one camera's pictures [frame], one after another; None without a silhouette.

    points: (N, 2) px. frames: (N,) the frame of each. at_border: (N,) bool.
    """

    def __init__(self, outlines: Sequence[Outline | None]) -> None:
        numbered = [(f, o) for f, o in enumerate(outlines) if o is not None and len(o.contour)]
        self.points = np.concatenate([o.contour for _, o in numbered] or [np.zeros((0, 2))])
        self.at_border = np.concatenate([o.contour_at_border for _, o in numbered] or [np.zeros(0)])
        lengths = [len(o.contour) for _, o in numbered]
        self.frames = np.repeat([f for f, _ in numbered], lengths).astype(int)
        self._begins = np.repeat(np.cumsum([0, *lengths])[:-1], lengths).astype(int)
        self._lengths = np.repeat(lengths, lengths).astype(int)
        every = np.arange(len(self.points))
        self._before, self._after = self._go_along(every, -1), self._go_along(every, 1)
        self._rays: dict[bytes, np.ndarray] = {}  # shared by copies with shifted frames

    def trace(self, camera: Camera) -> np.ndarray:
        """Return the rays (N, 3) of depth 1 in the camera's axes. They are kept: a contour has
        hundreds of points, and while a rig is adjusted its lenses mostly stay."""
        lens = camera.K.tobytes() + camera.lens.tobytes()
        if lens not in self._rays:
            self._rays.clear()
            rays = np.column_stack([camera.normalise(self.points), np.ones(len(self.points))])
            self._rays[lens] = rays
        return self._rays[lens]

    def _go_along(self, indices: np.ndarray, steps: np.ndarray | int) -> np.ndarray:
        """Return the indices of the points some steps along the closed contours."""
        begins = self._begins[indices]
        return np.asarray((indices - begins + steps) % self._lengths[indices] + begins)

    def find_tips(self, positions: np.ndarray) -> np.ndarray:
        """Return the indices (K,) of the local maxima of `positions` (N,) along the contours."""
        left, right = positions[self._before], positions[self._after]
        high = (positions >= left) & (positions >= right) & (positions > -np.inf)
        tips = np.nonzero(high & (self.at_border == 0))[0]
        neighbours = positions[self._go_along(tips[:, None], np.arange(-_SIDE, _SIDE + 1))]
        ends = np.maximum(neighbours[:, 0], neighbours[:, -1])
        tips = tips[(positions[tips] == neighbours.max(axis=1)) & (positions[tips] > ends)]
        new = np.diff(tips, prepend=-9) > 2  # a plateau counts once
        return tips[new]


@dataclass(frozen=True, eq=False)
class FrontierPoints:
    """Frontier points that two cameras see.

    views: (M, 2) the two cameras. frames: (M,). pixels: (M, 2, 2) in each camera's picture. rates:
    (M,) rad per frame by which their plane turns around the line between the cameras.
    """

    views: np.ndarray
    frames: np.ndarray
    pixels: np.ndarray
    rates: np.ndarray

    def __len__(self) -> int:
        return len(self.frames)

    def select(self, mask: np.ndarray) -> FrontierPoints:
        """Return the points that `mask` (M,) bool selects."""
        columns = self.views, self.frames, self.pixels, self.rates
        return FrontierPoints(*(column[mask] for column in columns))


def join_points(parts: Iterable[FrontierPoints]) -> FrontierPoints:
    """Return all points of `parts`, one after another."""
    empty = np.zeros((0, 2), int), np.zeros(0, int), np.zeros((0, 2, 2)), np.zeros(0)
    columns = [empty, *((p.views, p.frames, p.pixels, p.rates) for p in parts)]
    return FrontierPoints(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def find_frontier_points(
    cameras: Sequence[Camera],
    contours: Sequence[SilhouetteContours],
    scene: np.ndarray,
    gate: float,
    offsets: np.ndarray | None = None,
    bend: float = BEND,
) -> FrontierPoints:
    """Find the frontier points of all pairs of cameras that agree to `gate` px.

    scene: (3,) m, the middle of the scene. A point counts if its speed is known: if both cameras
    show it in the frames before and after, with speeds that change and differ by less than `bend`
    px per frame. offsets: (V,) frames by which each camera takes its pictures late, 0 by default:
    planes are compared at the nominal time of the frame.
    """
    late = np.zeros(len(cameras)) if offsets is None else offsets
    views = [_View(*camera_view, bend) for camera_view in zip(cameras, contours, late, strict=True)]
    pairs = list(combinations(range(len(cameras)), 2))
    return join_points(map_in_threads(lambda pair: _match_pair(views, pair, scene, gate), pairs))


class _View:
    """A camera, its contours, their rays (N, 3) in its axes, by how many frames its pictures are
    late, and the greatest change of a tip's speed, px per frame^2."""

    def __init__(
        self, camera: Camera, contours: SilhouetteContours, late: float, bend: float
    ) -> None:
        self.camera, self.contours, self.late, self.bend = camera, contours, late, bend
        self.rays = contours.trace(camera)


def _match_pair(
    views: list[_View], pair: tuple[int, int], scene: np.ndarray, gate: float
) -> FrontierPoints:
    both = [views[view] for view in pair]
    line, axes, distance = look_along_baseline(both[0].camera, both[1].camera, scene)
    if distance < NEAREST:
        return join_points([])
    slopes = []
    for view in both:
        ahead, aside = (view.camera.R @ axes).T @ view.rays.T
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = aside / ahead
            usable = (ahead > 0) & (np.abs(slope) < _STEEPEST)
        slopes.append(np.where(usable, slope, np.nan))
    matches = []
    for sign in (-1.0, 1.0):
        tips = [
            _Tips(view, sign * slope, sign, line) for view, slope in zip(both, slopes, strict=True)
        ]
        matches.append(_match_tips(tips[0], tips[1], gate))
    indices = np.concatenate([np.stack([tips[0], tips[1]], -1) for tips in matches])
    pixels = np.stack([view.contours.points[indices[:, k]] for k, view in enumerate(both)], 1)
    frames = both[0].contours.frames[indices[:, 0]]
    rates = np.concatenate([tips[2] for tips in matches])
    return FrontierPoints(np.tile(pair, (len(frames), 1)), frames, pixels, rates)


class _Tips:
    """The tips of one camera's contours: their indices, frames, angles (K,) rad, angles per pixel
    (K,), greatest changes of the turning rates (K,), these rates (K,) rad per frame, NaN where
    unknown, and angles (K,) at the nominal time of the frame."""

    def __init__(self, view: _View, slopes: np.ndarray, sign: float, line: np.ndarray) -> None:
        camera, contours = view.camera, view.contours
        tips = contours.find_tips(np.nan_to_num(slopes, nan=-np.inf))
        tips = tips[np.isfinite(slopes[tips])]
        normals = np.cross(camera.R @ line, view.rays[tips])
        lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
        across = np.linalg.norm(normals[:, :2], axis=1) / lengths
        self.per_pixel = across / (lengths * camera.K[0, 0])
        self.angles = sign * np.arctan(slopes[tips])
        self.indices, self.frames = tips, contours.frames[tips]
        self.most = view.bend * self.per_pixel
        self.rates = self._measure_rates(contours.points[tips])
        self.nominal = self.angles - view.late * np.nan_to_num(self.rates)

    def _measure_rates(self, pixels: np.ndarray) -> np.ndarray:
        if len(pixels) < 3:
            return np.full(len(pixels), np.nan)
        apart = 2 * _REACH  # frames, so that none is searched for in another
        tree = scipy.spatial.cKDTree(np.column_stack([pixels, self.frames * apart]))
        neighbour_angles = []
        for step in (-1, 1):
            wanted = np.column_stack([pixels, (self.frames + step) * apart])
            away, index = tree.query(wanted, distance_upper_bound=_REACH)
            known = np.isfinite(away)
            angles = np.full(len(pixels), np.nan)
            angles[known] = self.angles[index[known]]
            neighbour_angles.append(angles)
        bend = np.abs(neighbour_angles[0] + neighbour_angles[1] - 2 * self.angles)
        rates: np.ndarray = 0.5 * (neighbour_angles[1] - neighbour_angles[0])
        rates[~(bend < self.most)] = np.nan
        return rates


def _match_tips(a: _Tips, b: _Tips, gate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the contours' indices (K,) of tips that are each other's nearest in angle, and their
    rates (K,)."""
    if not len(a.indices) or not len(b.indices):
        return np.zeros(0, int), np.zeros(0, int), np.zeros(0)
    there, away = _find_nearest(a, b)
    back, _ = _find_nearest(b, a)
    per_pixel = np.hypot(a.per_pixel, b.per_pixel[there])
    rates = 0.5 * (a.rates + b.rates[there])
    with np.errstate(invalid="ignore"):
        alike = np.abs(a.rates - b.rates[there]) < np.hypot(a.most, b.most[there])
    mutual = (back[there] == np.arange(len(there))) & (away < gate * per_pixel) & alike
    return a.indices[mutual], b.indices[there[mutual]], rates[mutual]


def _find_nearest(a: _Tips, b: _Tips) -> tuple[np.ndarray, np.ndarray]:
    """Return for each tip of `a` the tip of `b` in the same frame with the nearest nominal angle,
    and the difference, rad; large where there is none."""
    apart = 4 * np.pi  # between frames: two turns, for angles are less than one
    keys = b.frames * apart + b.nominal
    order = np.argsort(keys)
    wanted = a.frames * apart + a.nominal
    right = np.searchsorted(keys[order], wanted).clip(0, len(keys) - 1)
    left = np.maximum(right - 1, 0)
    nearer = np.abs(keys[order[left]] - wanted) < np.abs(keys[order[right]] - wanted)
    nearest = order[np.where(nearer, left, right)]
    return nearest, np.abs(keys[nearest] - wanted)


def epipolar_residuals(
    cameras: Sequence[Camera], points: FrontierPoints, offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the residuals (M,) px of frontier points and their derivatives (M, 2, 8).

    A residual is the Sampson distance of the two pixels from the epipolar constraint
    d_b . (l x d_a) = 0, l the line between the cameras, at the nominal time of the frame: camera v
    took its picture offsets[v] frames later. The derivatives are those by a camera's rotation
    vector in its own axes (3), centre (3) m, log of the focal length, and offset, frames.
    """
    K = np.stack([camera.K for camera in cameras])
    R = np.stack([camera.R for camera in cameras])
    centres = np.stack([camera.centre for camera in cameras])
    rays = trace_points(cameras, points)
    local_rays = np.einsum("mkij,mkj->mki", R[points.views], rays)
    a, b = points.views.T
    line = centres[b] - centres[a]
    length = np.linalg.norm(line, axis=1, keepdims=True)
    line = line / length
    normals = np.stack([np.cross(rays[:, 1], line), np.cross(line, rays[:, 0])], 1)
    local = np.einsum("mkij,mkj->mki", R[points.views], normals)  # d residual / d ray, own axes
    focal = K[points.views, 0, 0]
    per_pixel = np.linalg.norm(np.linalg.norm(local[..., :2], axis=2) / focal, axis=1)
    sizes = np.linalg.norm(normals, axis=2).prod(axis=1)
    by_offset = sizes * points.rates
    residuals = (normals[:, 1] * rays[:, 1]).sum(1) + by_offset * (offsets[a] - offsets[b])
    slopes = np.empty((len(points), 2, 8))
    slopes[..., :3] = np.cross(local, local_rays)
    by_centre = np.cross(rays[:, 0], rays[:, 1]) / length
    slopes[:, 0, 3:6], slopes[:, 1, 3:6] = -by_centre, by_centre
    slopes[..., 6] = -(local[..., :2] * local_rays[..., :2]).sum(-1)
    slopes[:, 0, 7], slopes[:, 1, 7] = by_offset, -by_offset
    return residuals / per_pixel, slopes / per_pixel[:, None, None]


def trace_points(cameras: Iterable[Camera], points: FrontierPoints) -> np.ndarray:
    """Return the rays (M, 2, 3) of depth 1 of the points' pixels, in the world's axes."""
    rays = np.empty((len(points), 2, 3))
    for view, camera in enumerate(cameras):
        for side in range(2):
            mine = points.views[:, side] == view
            if mine.any():
                rays[mine, side] = camera.rays(points.pixels[mine, side])
    return rays

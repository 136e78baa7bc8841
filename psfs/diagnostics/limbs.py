"""Points on the axes of limbs as measurements of the cameras.

Frontier points tell badly how cameras stand around somebody who stays in place, and silhouettes
that are too wide or too narrow move them. The medial axis of a limb does not move with the width.
A point of it in one camera is tried at all depths: where it is right, the others see an axis of
the same width. Each camera measures the point's distance across its axis; along the axis only
the first camera tells the place. The points are eliminated from the normal equations.

Where two stretches of a contour face each other, their middles are the limb's medial axis. It is
the projection of the axis of a limb, whose cross-sections are nearly symmetric, and does not move
if the silhouette is too wide or too narrow.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise

import cv2
import numpy as np
import scipy

from psfs.cameras.camera import Camera
from psfs.common.least_squares import Parameters, Residuals, Slope, solve
from psfs.common.progress import map_in_threads
from psfs.diagnostics.frontier import SilhouetteContours
from psfs.diagnostics.hulls import HullRays, measure_sight
from psfs.diagnostics.refinement import N_PARAMETERS, NOISE, Further, measure_points
from psfs.footage.camera_times import INDEPENDENT_SHARE

#: Standard deviation of the contours' smoothing, px; least cosine between the edges of a limb.
_SMOOTH, OPPOSITE = 2.0, 0.9
#: Points of a contour on either side by which its direction is measured.
_SIDE = 3
#: Farthest way of a facing point aside, px, and its least distance: nearer ones are neighbours.
_ASIDE, _NEXT = 0.9, 2.0
#: Pixels of a cell of the map of nearest points, and its greatest distance in cells.
_CELL, _FARTHEST = 4, 3
#: Cells around the picture, for points without the lens's distortion.
_MARGIN = 20


class MedialAxes:
    """N points of the medial axes of one camera's contours in F frames.

    frames: (N,) in ascending order. pixels: (N, 2) px from the principal point of a
    picture without distortion. across: (N, 2) unit vectors across the limb. widths: (N,) px.
    nearest: (F, h, w) index of a cell's nearest point in each frame, -1 without one nearby.
    """

    def __init__(self, camera: Camera, contours: SilhouetteContours) -> None:
        count = int(contours.frames.max(initial=-1)) + 1
        pixels = camera.K[0, 0] * camera.normalise(contours.points)
        begins = np.searchsorted(contours.frames, np.arange(count + 1))
        middles = [
            _find_middles(pixels[begin:end], contours.at_border[begin:end] > 0)
            for begin, end in pairwise(begins)
        ]
        self.frames = np.repeat(np.arange(count), [len(columns[2]) for columns in middles])
        none = np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
        columns = map(np.concatenate, zip(none, *middles, strict=True))
        self.pixels, self.across, self.widths = columns
        shape = tuple(side // _CELL + 2 * _MARGIN for side in camera.size[::-1])
        self.nearest = _map_nearest(self.pixels, self.frames, count, shape)

    def find_nearest(self, frames: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        """Return the indices (...) of the points nearest to pixels (..., 2) in frames (...); -1
        without one nearby."""
        count, height, width = self.nearest.shape
        cells = _find_cells(pixels, (height, width))
        x, y = cells[..., 0], cells[..., 1]
        frames = np.broadcast_to(frames, x.shape)
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height) & (frames >= 0) & (frames < count)
        indices = np.full(x.shape, -1)
        indices[inside] = self.nearest[frames[inside], y[inside], x[inside]]
        return indices


def _find_middles(
    pixels: np.ndarray, at_border: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the middles (N, 2) between facing points of a closed contour, the unit vectors across
    (N, 2) and the widths (N,)."""
    if len(pixels) < 4 * _SIDE:
        return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
    smooth = scipy.ndimage.gaussian_filter1d(pixels, _SMOOTH, axis=0, mode="wrap")
    along = np.roll(smooth, -_SIDE, 0) - np.roll(smooth, _SIDE, 0)
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-12
    after = np.roll(smooth, -1, 0)
    side = np.sign((smooth[:, 0] * after[:, 1] - after[:, 0] * smooth[:, 1]).sum())
    inward = side * np.stack([-along[:, 1], along[:, 0]], -1)
    first = np.arange(0, len(pixels), 2)
    start = smooth[first]
    depth = inward[first] @ smooth.T - (inward[first] * start).sum(1)[:, None]
    aside = along[first] @ smooth.T - (along[first] * start).sum(1)[:, None]
    depth[(np.abs(aside) > _ASIDE) | (depth < _NEXT)] = np.inf
    second = depth.argmin(axis=1)
    facing = np.isfinite(depth[np.arange(len(first)), second]) & ~at_border[first]
    first, second = first[facing & ~at_border[second]], second[facing & ~at_border[second]]
    cosines = (inward[first] * inward[second]).sum(1)
    opposite = cosines < -OPPOSITE
    first, second, cosines = first[opposite], second[opposite], cosines[opposite]
    widths = ((smooth[second] - smooth[first]) * inward[second]).sum(1) / cosines
    across = inward[first] - inward[second]
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    middles = smooth[first] + 0.5 * widths[:, None] * inward[first]
    return middles, across, widths


def _find_cells(pixels: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return the columns and rows (..., 2) of pixels (..., 2), the principal point in the middle;
    -1 far outside."""
    cells = pixels / _CELL + 0.5 * np.array(shape[::-1])
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(cells) < 1e4, cells, -1).astype(int)


def _map_nearest(
    pixels: np.ndarray, frames: np.ndarray, count: int, shape: tuple[int, ...]
) -> np.ndarray:
    nearest = np.full((count, *shape), -1, np.int32)
    cells = _find_cells(pixels, shape).clip(0, np.array(shape[::-1]) - 1)
    begins = np.searchsorted(frames, np.arange(count + 1))
    for frame, (begin, end) in enumerate(pairwise(begins)):
        if begin == end:
            continue
        x, y = cells[begin:end].T
        empty = np.ones(shape, np.uint8)
        empty[y, x] = 0
        away, labels = cv2.distanceTransformWithLabels(
            empty, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        of_label = np.zeros(labels.max() + 1, int)
        of_label[labels[y, x]] = np.arange(begin, end)
        nearest[frame] = np.where(away <= _FARTHEST, of_label[labels], -1)
    return nearest


#: Widths of limbs, statures, and the greatest ratio of a limb's widths in two cameras.
_THINNEST, _WIDEST, _ALIKE = 0.018, 0.13, 1.4
#: Depths that are searched around the person's middle, and their step, statures.
_AROUND, _STEP = 0.75, 0.011
#: Fewest cameras that see a point.
_VIEWS = 3
#: Distance of a point from an axis up to which they agree, px, and greatest angle between a limb's
#: direction and the plane in which a camera sees it, rad.
_GATE, _STRAIGHT = 5.0, 0.35
#: Points of each camera that are searched in the others.
_PER_CAMERA = 1200
#: Information of the place along the axis: it fixes the point and tells no camera anything.
_ALONG = 1e-2


def measure_limbs(
    hulls: Sequence[HullRays], contours: Sequence[SilhouetteContours]
) -> tuple[list[MedialAxes], np.ndarray]:
    """Return the axes of limbs in the contours of each of V views, and where these see the person
    (V, 3), see `measure_sight`."""
    pairs = list(zip(hulls, contours, strict=True))
    axes = map_in_threads(lambda pair: MedialAxes(pair[0].camera, pair[1]), pairs)
    return list(axes), np.stack([measure_sight(view_hulls) for view_hulls in hulls])


class LimbPoints:
    """Measurements by points on limbs' axes, found by V cameras of `lags` (V,) frames around the
    person's middle (3,), within reach of the stature."""

    def __init__(
        self, cameras: Sequence[Camera], lags: np.ndarray, axes: Sequence[MedialAxes],
        middle: np.ndarray, stature: float,
    ) -> None:  # fmt: skip
        chosen = [
            _find_points(view, cameras, lags, axes, middle, stature) for view in range(len(cameras))
        ]
        self._traced = _Traced(cameras, lags, axes, chosen)
        self._items, self._views = np.nonzero(self._traced.known)
        if len(self):  # the depths that were tried are steps apart
            held = np.zeros((len(cameras), N_PARAMETERS))
            moved = solve(
                partial(self._measure, cameras, lags),
                {"cameras": held, "limbs": np.zeros((len(self), 3))},
                steps=3, eliminate=["limbs"], free={"cameras": held > 0},
            ).parameters["limbs"]  # fmt: skip
            self._traced.points += moved

    def __len__(self) -> int:
        return len(self._traced.times)

    def bind(self, shifts: np.ndarray) -> Further:
        """Return the measurements in shifted frames, for `fit_rig`."""
        if not len(self):
            return Further({}, lambda *_: [])
        return Further(
            {"limbs": np.zeros((len(self), 3))},
            lambda cameras, offsets, moves: self._measure(cameras, shifts - offsets, moves),
        )

    def _measure(
        self, cameras: Sequence[Camera], lags: np.ndarray, parameters: Parameters
    ) -> list[Residuals]:
        """Return the residuals, px, across the axes, of points moved by `parameters`, and along the
        axis of the first camera, which fixes the point and tells no camera anything."""
        traced, items, views = self._traced, self._items, self._views
        points = (traced.points + parameters["limbs"])[items]
        share = (traced.times[items] + lags[views] - traced.frames[items, views])[:, None]
        before, after = traced.pixels[items, views].swapaxes(0, 1)
        speeds = after - before
        errors, by_camera, by_point = measure_points(
            cameras, views, points, before + share * speeds, speeds
        )
        across = traced.across[items, views]
        along = np.stack([-across[:, 1], across[:, 0]], -1)
        away, by_camera, pull = (
            np.einsum("mi,mi...->m...", across, values) for values in (errors, by_camera, by_point)
        )
        both = [Slope("cameras", views, by_camera[:, None]), Slope("limbs", items, pull[:, None])]
        crossing = Residuals(away, both, weights=INDEPENDENT_SHARE, least=NOISE)
        first = views == traced.firsts[items]
        away, pull = (np.einsum("mi,mi...->m...", along, v)[first] for v in (errors, by_point))
        fixed = Residuals(
            away, [Slope("limbs", items[first], pull[:, None])], sigma=NOISE,
            weights=INDEPENDENT_SHARE * _ALONG, robust=False,
        )  # fmt: skip
        return [crossing, fixed]


def _find_points(
    view: int, cameras: Sequence[Camera], lags: np.ndarray, axes: Sequence[MedialAxes],
    person: np.ndarray, stature: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return indices (N,) of a camera's medial points and the points (N, 3) in space at whose depth
    most other cameras see an axis of the same width."""
    camera, view_axes = cameras[view], axes[view]
    if not np.isfinite(stature):  # nobody is seen wholly
        return np.zeros(0, int), np.zeros((0, 3))
    chosen = np.arange(0, len(view_axes.frames), max(1, len(view_axes.frames) // _PER_CAMERA))
    middle = (person - camera.centre) @ camera.R[2]
    around, step = _AROUND * stature, _STEP * stature
    depths = np.arange(max(step, middle - around), middle + around, step)
    if not len(chosen) or not len(depths):
        return np.zeros(0, int), np.zeros((0, 3))
    focal = camera.K[0, 0]
    rays = np.column_stack([view_axes.pixels[chosen] / focal, np.ones(len(chosen))]) @ camera.R
    widths = view_axes.widths[chosen][:, None] * depths / focal
    sound = (widths > _THINNEST * stature) & (widths < _WIDEST * stature)
    tried, widths = np.flatnonzero(sound), widths[sound]
    of_ray, of_depth = np.divmod(tried, len(depths))
    points = camera.centre + rays[of_ray] * depths[of_depth, None]
    costs = np.where(sound, 0.0, np.inf)
    votes = np.ones(costs.shape, int)
    for number, (other, seen) in enumerate(zip(cameras, axes, strict=True)):
        if number == view or not len(seen.frames):
            continue
        pixels, z = _project(other, points)
        frames = np.round(view_axes.frames[chosen] - lags[view] + lags[number]).astype(int)
        nearest = seen.find_nearest(frames[of_ray], pixels)
        met = nearest >= 0
        nearest, pixels, z = nearest[met], pixels[met], z[met]
        away = ((pixels - seen.pixels[nearest]) * seen.across[nearest]).sum(-1) / _GATE
        agree = np.abs(away) < 1
        agree &= _are_alike(seen.widths[nearest] * z / other.K[0, 0], widths[met])
        costs.flat[tried[met]] -= np.where(agree, 1 - away**2, 0)
        votes.flat[tried[met]] += agree
    best, rows = costs.argmin(axis=1), np.arange(len(chosen))
    accepted = np.isfinite(costs[rows, best]) & (votes[rows, best] >= _VIEWS)
    return chosen[accepted], camera.centre + rays[accepted] * depths[best[accepted], None]


def _project(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels (..., 2), px from the principal point without distortion, and depths (...)
    of points (..., 3)."""
    local = (points - camera.centre) @ camera.R.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return camera.K[0, 0] * local[..., :2] / local[..., 2:], local[..., 2]


def _are_alike(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return (first < _ALIKE * second) & (second < _ALIKE * first)


class _Traced:
    """S points on limbs' axes, found from each of V cameras, and what all cameras tell of them.

    times: (S,) frames of the first camera. firsts: (S,) the cameras in which they were chosen.
    points: (S, 3). known: (S, V) bool. frames: (S, V) the picture before the time. across: (S, V,
    2) unit vectors across the axis. pixels: (S, V, 2, 2) on the axis in the pictures before and
    after, px from the principal point.
    """

    def __init__(
        self, cameras: Sequence[Camera], lags: np.ndarray, axes: Sequence[MedialAxes],
        chosen: Sequence[tuple[np.ndarray, np.ndarray]],
    ) -> None:  # fmt: skip
        firsts = np.repeat(np.arange(len(chosen)), [len(view_axes) for view_axes, _ in chosen])
        indices, points = (np.concatenate(columns) for columns in zip(*chosen, strict=True))
        n, views = len(points), len(cameras)
        times, widths = np.zeros(n), np.zeros(n)
        for view, (camera, view_axes) in enumerate(zip(cameras, axes, strict=True)):
            mine = firsts == view
            times[mine] = view_axes.frames[indices[mine]] - lags[view]
            depths = (points[mine] - camera.centre) @ camera.R[2]
            widths[mine] = view_axes.widths[indices[mine]] * depths / camera.K[0, 0]
        known, frames = np.zeros((n, views), bool), np.zeros((n, views), int)
        across, pixels = np.zeros((n, views, 2)), np.zeros((n, views, 2, 2))
        planes = np.zeros((n, views, 3))
        for view, (camera, view_axes) in enumerate(zip(cameras, axes, strict=True)):
            if not len(view_axes.frames):
                continue
            mine, at = firsts == view, times + lags[view]
            frames[:, view] = np.where(mine, np.round(at), np.floor(at))
            seen, z = _project(camera, points)
            pair = [view_axes.find_nearest(frames[:, view] + later, seen) for later in (0, 1)]
            pair[0] = np.where(mine, indices, pair[0])
            normals = [view_axes.across[nearest] for nearest in pair]
            cosines = (normals[0] * normals[1]).sum(1)
            normals[1] = normals[1] * np.sign(cosines)[:, None]
            sound = np.abs(cosines) > OPPOSITE
            mean = normals[0] + normals[1]
            mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9)
            for later, (nearest, normal) in enumerate(zip(pair, normals, strict=True)):
                away = ((seen - view_axes.pixels[nearest]) * normal).sum(1)
                sound &= (nearest >= 0) & (np.abs(away) < (2 + later) * _GATE)
                sound &= _are_alike(view_axes.widths[nearest] * z / camera.K[0, 0], widths)
                pixels[:, view, later] = seen - away[:, None] * mean
            known[:, view], across[:, view] = sound, mean
            plane = np.column_stack([camera.K[0, 0] * mean, -(mean * seen).sum(1)]) @ camera.R
            planes[:, view] = plane / np.linalg.norm(plane, axis=1, keepdims=True)
        # The limb lies in the plane in which each camera sees it.
        spread = np.einsum("nvi,nvj,nv->nij", planes, planes, known)
        directions = np.linalg.eigh(spread)[1][:, :, 0]
        known &= np.abs(np.einsum("nvi,ni->nv", planes, directions)) < np.sin(_STRAIGHT)
        accepted = (known.sum(axis=1) >= _VIEWS) & known[np.arange(n), firsts]
        self.times, self.firsts, self.points = times[accepted], firsts[accepted], points[accepted]
        self.known, self.frames = known[accepted], frames[accepted]
        self.across, self.pixels = across[accepted], pixels[accepted]

"""The point where a rig's optical axes meet, the box that its cameras see, and cells of pixels."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from psfs.cameras.camera import Camera, CameraRig

#: Points along a side of the lattices; odd, so that the centre is one of them.
_COARSE, _FINE = 21, 41
#: Cameras that are less than this apart, m, are at the same place.
SAME_PLACE = 1e-3


def axis_projectors(rig: CameraRig) -> np.ndarray:
    """Return I - d d^T (V, 3, 3) of every camera, d its viewing direction.

    It projects a vector onto the plane perpendicular to the optical axis.
    """
    axes = np.stack([camera.R[2] for camera in rig])
    return np.eye(3) - axes[:, :, None] * axes[:, None, :]


def intersect_axes(rig: CameraRig) -> np.ndarray:
    """Find the point (3,) m with the least sum of squared distances to the optical axes.

    Solves sum_v (I - d d^T) (x - c) = 0, d the viewing direction, c the centre of camera v. For one
    camera or parallel ones, returns the solution nearest to the mean camera centre.
    """
    middle = rig.centres.mean(axis=0)
    A, b = np.zeros((3, 3)), np.zeros(3)
    for camera, across in zip(rig, axis_projectors(rig), strict=True):
        A += across
        b += across @ (camera.centre - middle)
    return middle + np.linalg.lstsq(A, b, rcond=1e-6)[0]


def intersect_axes_ahead(rig: CameraRig) -> np.ndarray:
    """Find the same point (3,) m, weakly regularised towards one in front of the cameras.

    This keeps it in view where the axes are parallel and meet nowhere.
    """
    axes, projectors = np.stack([camera.R[2] for camera in rig]), axis_projectors(rig)
    distance = float(np.linalg.norm(rig.centres - rig.centres.mean(0), axis=1).mean()) or 3.0
    ahead = (rig.centres + distance * axes).mean(0)
    pull = 1e-3 * np.eye(3)  # small compared with the projectors' eigenvalues, 0 and 1
    moments = (projectors @ rig.centres[:, :, None]).sum(0)[:, 0]
    return np.linalg.solve(projectors.sum(0) + pull, moments + pull @ ahead)


def look_along_baseline(
    first: Camera, second: Camera, scene: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the direction (3,) from one camera to another, two directions (3, 2) across it, the
    first towards `scene`, and the scene's distance from the cameras' line, m; 0 if the cameras are
    at the same place and thus have no line."""
    line = second.centre - first.centre
    length = float(np.linalg.norm(line))
    line = line / max(length, 1e-12)
    ahead = scene - first.centre
    ahead = ahead - line * (ahead @ line)
    distance = float(np.linalg.norm(ahead)) if length >= SAME_PLACE else 0.0
    ahead = ahead / max(distance, 1e-12)
    return line, np.stack([ahead, np.cross(line, ahead)], -1), distance


def transfer_poses(
    cameras: Iterable[Camera], before: Iterable[Camera], after: Iterable[Camera]
) -> CameraRig:
    """Return cameras with the poses that others have `after` they were found, and with the changes
    of these ones' focal lengths since `before`."""
    return CameraRig(
        tuple(
            replace(camera.refocused(new.K[0, 0] / old.K[0, 0]), R=new.R, t=new.t)
            for camera, old, new in zip(cameras, before, after, strict=True)
        )
    )


def required_cameras(n_cameras: int, share: float, least: int = 1) -> int:
    """Return how many of `n_cameras` make up `share`, rounded up.

    At least `least`, and never more than there are.
    """
    return min(n_cameras, max(least, math.ceil(share * n_cameras - 1e-9)))


def required_views(rig: CameraRig) -> int:
    """Return how many cameras must see a point worth reconstructing: three quarters."""
    return required_cameras(len(rig), 0.75)


def find_seen_points(rig: CameraRig, needed: int) -> np.ndarray:
    """Find the points (N, 3) m of a coarse regular lattice that at least `needed` cameras see.

    The lattice is centred where the axes meet and extends to the farthest camera.
    """
    centre = intersect_axes(rig)
    reach = max(np.linalg.norm(rig.centres - centre, axis=1).max(), 1e-9)
    return keep_seen(rig, _lattice(centre - reach, centre + reach, _COARSE), needed)


def find_seen_box(rig: CameraRig, needed: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Find the low and high corner (3,) m of what `needed` cameras see; None for nothing."""
    points = find_seen_points(rig, needed)
    if not len(points):
        return None
    step = 2 * np.linalg.norm(rig.centres - intersect_axes(rig), axis=1).max() / (_COARSE - 1)
    finer = _lattice(points.min(axis=0) - step, points.max(axis=0) + step, _FINE)
    points = np.concatenate([points, keep_seen(rig, finer, needed)])
    return points.min(axis=0), points.max(axis=0)


def _lattice(low: np.ndarray, high: np.ndarray, steps: int) -> np.ndarray:
    axes = [np.linspace(a, b, steps) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def keep_seen(rig: CameraRig, points: np.ndarray, needed: int) -> np.ndarray:
    """Return those of the points (N, 3) m that at least `needed` cameras see."""
    views = np.sum([camera.look_up(points)[0] for camera in rig], axis=0)
    return points[views >= needed]


#: Edge of a cell, px. The kernels' layout of packs and blocks depends on it.
CELL = 4


def cells(rig: CameraRig) -> tuple[int, int]:
    """Return the rows and columns of cells that cover the largest picture."""
    return -(-rig.height // CELL), -(-rig.width // CELL)


@lru_cache(maxsize=2)  # all reconstructions of a take ask for those of its rig, or a small one
def cell_rays(rig: CameraRig) -> np.ndarray:
    """Return the world directions (V, rows, columns, 3), of depth 1, of the rays through the
    middles of the cells; NaN where a lens shows nothing. The array is cached: do not write to
    it."""
    rows, columns = cells(rig)
    u, v = np.meshgrid(np.arange(columns), np.arange(rows))
    pixels = (CELL * np.stack([u, v], -1) + (CELL - 1) / 2).reshape(-1, 2)
    rays = np.stack([camera.rays(pixels).reshape(rows, columns, 3) for camera in rig])
    rays.flags.writeable = False
    return rays


def floor_points(rig: CameraRig, height: float) -> np.ndarray:
    """Return x and y (V, rows, columns, 2), m, of the point of the floor at `height`, m, in the
    middle of each cell; NaN where it shows no floor, and everywhere for a height that is NaN.

    The floor is the circle around the point that the cameras look at, with the distance of the
    farthest camera as its radius.
    """
    middle = intersect_axes(rig)[:2]
    radius = np.linalg.norm(rig.centres[:, :2] - middle, axis=1).max()
    points = np.full((len(rig), *cells(rig), 2), np.nan)
    for view_points, camera, rays in zip(points, rig, cell_rays(rig), strict=True):
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (height - camera.centre[2]) / rays[..., 2]
            hits = camera.centre[:2] + distance[..., None] * rays[..., :2]
            inside = (np.linalg.norm(hits - middle, axis=-1) < radius) & (distance > 0)
        view_points[inside] = hits[inside]
    return points


def voxel_footprints(rig: CameraRig, voxel_size: float) -> np.ndarray:
    """Return half the width and height (V, 2) of a projected voxel times its depth, px m.

    A cube of edge s rotated by R extends s times the sum of a row of |R| along a camera axis. Boxes
    of this size leave no gap between neighbouring voxels, however the camera is rotated.
    """
    spans = [np.abs(camera.R[:2]).sum(1) * np.diag(camera.K)[:2] for camera in rig]
    return 0.5 * voxel_size * np.array(spans)


def pixel_boxes(
    camera: Camera, centres: np.ndarray, footprint: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the pixel box that each voxel around `centres` (N, 3) m covers in the picture.

    Returns, for the K voxels that are visible, first column and row (K, 2), last column and row + 1
    (K, 2), and depths (K,) m. footprint: (2,), one row of `voxel_footprints`. A voxel covers at
    least the nearest pixel, however small it is.
    """
    pixels, depth = camera.project(centres)
    front = depth > 0
    pixels, depth = pixels[front], depth[front]
    half, nearest = footprint / depth[:, None], np.floor(pixels + 0.5)
    low = np.maximum(np.minimum(np.ceil(pixels - half), nearest), 0)
    last = np.maximum(np.floor(pixels + half), nearest)
    end = np.minimum(last + 1, np.array(camera.size, float))
    hit = (low < end).all(1)
    return low[hit].astype(int), end[hit].astype(int), depth[hit]

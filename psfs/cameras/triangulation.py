"""Triangulate points of several cameras: keypoints, and rays of any kind.

Confidence-weighted linear triangulation (Hartley & Sturm 1997, "Triangulation", 5.1): minimises
sum_i w_i^2 |x_i P_i3 X - P_i1 X, y_i P_i3 X - P_i2 X|^2 over the unit vectors X (4,). Cameras whose
keypoint lies far from the others' are excluded one by one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.config import TriangulationConfig as TriangulationConfig


@dataclass(frozen=True, eq=False)
class Triangulation:
    """Triangulated points.

    points: (..., 3) m in the world, NaN where rejected. errors: (...) px, mean reprojection error
    over the cameras used. used: (V, ...) bool, which cameras they are.
    """

    points: np.ndarray
    errors: np.ndarray
    used: np.ndarray


def triangulate(
    rig: CameraRig, keypoints: np.ndarray, config: TriangulationConfig | None = None
) -> Triangulation:
    """Triangulate undistorted keypoints (V, ..., 3) px, px, confidence; NaN where missing.

    Starts with all cameras; while the mean reprojection error is at or above `max_error`, excludes
    the camera without which it is smallest.
    """
    config = config or TriangulationConfig()
    shape = keypoints.shape[1:-1]
    seen = np.asarray(keypoints, np.float64).reshape(len(rig), -1, 3)
    used = np.isfinite(seen).all(-1) & (np.nan_to_num(seen[..., 2]) >= config.min_confidence)
    points, errors = _solve(rig, seen, used)
    open_ = np.flatnonzero((errors >= config.max_error) & (used.sum(0) > config.min_cameras))
    while open_.size:
        best = np.full(len(open_), np.inf)
        best_points, leaves = np.full((len(open_), 3), np.nan), np.full(len(open_), -1)
        for view in range(len(rig)):
            trial = used[:, open_].copy()
            had = trial[view].copy()
            trial[view] = False
            solved, off = _solve(rig, seen[:, open_], trial)
            better = had & (off < best)
            best[better], best_points[better], leaves[better] = off[better], solved[better], view
        left = leaves >= 0
        used[leaves[left], open_[left]] = False
        points[open_[left]], errors[open_[left]] = best_points[left], best[left]
        again = left & (best >= config.max_error)
        again &= used[:, open_].sum(0) > config.min_cameras
        open_ = open_[again]
    good = (errors < config.max_error) & (used.sum(0) >= config.min_cameras)
    points[~good], errors[~good], used[:, ~good] = np.nan, np.nan, False
    return Triangulation(
        points.reshape(*shape, 3), errors.reshape(shape), used.reshape(len(rig), *shape)
    )


def intersect_rays(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Return the points (..., 3) with the least sum of squared distances to rays from `origins`
    (..., V, 3) along `directions` (..., V, 3), of any length, NaN where there is none; NaN where
    fewer than two are there."""
    origins, directions = np.broadcast_arrays(origins, directions)
    seen = np.all(np.isfinite(directions), axis=-1)
    unit = np.where(seen[..., None], directions, 1.0)
    unit = unit / np.linalg.norm(unit, axis=-1, keepdims=True)
    across = seen[..., None, None] * (np.eye(3) - unit[..., :, None] * unit[..., None, :])
    moments = np.einsum("...vij,...vj->...i", across, origins)
    total = across.sum(axis=-3) + 1e-9 * np.eye(3)
    points = np.linalg.solve(total, moments[..., None])[..., 0]
    return np.where(seen.sum(axis=-1)[..., None] > 1, points, np.nan)


def triangulate_rays(cameras: Iterable[Camera], pixels: np.ndarray) -> np.ndarray:
    """Return the points (P, 3) nearest to the rays of their pixels (V, P, 2) in all cameras; NaN
    where less than two see one."""
    views = [(camera.centre, camera.rays(at)) for camera, at in zip(cameras, pixels, strict=True)]
    centres, rays = zip(*views, strict=True)
    return intersect_rays(np.stack(centres), np.stack(rays, axis=1))


def undistort_points(rig: CameraRig | Sequence[Camera], points: np.ndarray) -> np.ndarray:
    """Return keypoints (V, ..., 2 or more) px as the same cameras without distortion would see
    them, float64; NaN where that is not possible."""
    straight = np.array(points, np.float64)
    for view, camera in zip(straight, rig, strict=True):
        if camera.lens.any():
            view[..., :2] = camera.undistort(view[..., :2])
    return straight


def reprojection_errors(rig: CameraRig, seen: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the reprojection errors (V, N) px of points (N, 3) m, without lens distortion.

    seen: undistorted keypoints (V, N, 2 or more). Infinite behind a camera, NaN where missing.
    """
    errors = np.empty(seen.shape[:2])
    for view, camera in enumerate(rig):
        with np.errstate(divide="ignore", invalid="ignore"):  # points at infinity
            local = points @ camera.R.T + camera.t
            pixels = (local @ camera.K.T)[:, :2] / local[:, 2:]
            off = np.hypot(*(pixels - seen[view, :, :2]).T)
        errors[view] = np.where(local[:, 2] > 0, off, np.inf)
        errors[view][np.isnan(off)] = np.nan
    return errors


def _solve(rig: CameraRig, seen: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solve for points (N, 3) m and their mean reprojection errors (N,) px.

    used: cameras (V, N). The error is infinite if fewer than two of them see the point.
    """
    n = seen.shape[1]
    rows = np.zeros((n, 2 * len(rig), 4))
    for view, camera in enumerate(rig):
        extrinsic = np.column_stack([camera.R, camera.t])
        inverse = np.linalg.inv(camera.K)
        pixel = np.column_stack([np.nan_to_num(seen[view, :, :2]), np.ones(n)])
        plane = pixel @ inverse.T  # normalised coordinates condition the equations well
        weight = np.where(used[view], np.nan_to_num(seen[view, :, 2]), 0.0)[:, None]
        weight = weight * camera.K[0, 0]  # so that an error counts in pixels
        rows[:, 2 * view] = weight * (plane[:, :1] * extrinsic[2] - extrinsic[0])
        rows[:, 2 * view + 1] = weight * (plane[:, 1:2] * extrinsic[2] - extrinsic[1])
    homogeneous = np.linalg.svd(rows, full_matrices=False)[2][:, -1]
    with np.errstate(divide="ignore", invalid="ignore"):
        points = homogeneous[:, :3] / homogeneous[:, 3:]
    count = used.sum(0)
    off = reprojection_errors(rig, seen, points)
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.where(used, off, 0.0).sum(0) / count
    errors[(count < 2) | np.isnan(errors)] = np.inf
    return points, errors

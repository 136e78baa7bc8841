"""Errors of particles against the voxels. Twin of likelihood.cl."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from apf.body.cones import distances, outlines, overlap_errors
from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.reference.silhouette_recall import uncovered_errors
from psfs.cameras.camera import Camera, CameraRig


def image_errors(
    camera: Camera, cones: np.ndarray, maps: np.ndarray, sampling: np.ndarray
) -> np.ndarray:
    """Song et al. eq. (14)-(15) for one camera: (N, C, 4) sums over each cone's samples.

    cones (N, C, 16), maps (H, W, 2) uint8 silhouette and edge proximity, sampling (C, 2) rows and
    columns. Returned: edge error, edge samples, silhouette error, silhouette samples; samples
    outside the image, and cones with a corner that has no image, count nothing.
    """
    corners = outlines(camera, cones)
    sums = np.zeros((*cones.shape[:2], 4))
    for c, (rows, columns) in enumerate(sampling):
        t = ((np.arange(rows) + 0.5) / rows)[:, None, None]
        u = np.concatenate([[0.0], (np.arange(columns) + 0.5) / columns, [1.0]])[:, None]
        quad = corners[:, c, :, None, None]
        left = quad[:, 0] + t * (quad[:, 3] - quad[:, 0])
        right = quad[:, 1] + t * (quad[:, 2] - quad[:, 1])
        pixels = left + u * (right - left)  # (N, rows, columns + 2, 2)
        x, y = np.moveaxis(np.rint(np.nan_to_num(pixels, nan=-1e6)), -1, 0)
        inside = (x >= 0) & (y >= 0) & (x < camera.size[0]) & (y < camera.size[1])
        value = maps[np.where(inside, y, 0).astype(int), np.where(inside, x, 0).astype(int)]
        error = np.where(inside[..., None], 1 - value / 255.0, 0.0)
        for place, columns_of, channel in ((0, [0, -1], 1), (2, slice(1, -1), 0)):
            sums[:, c, place] = error[:, :, columns_of, channel].sum((1, 2))
            sums[:, c, place + 1] = inside[:, :, columns_of].sum((1, 2))
    return sums


def sampled_surface(centres: np.ndarray, n_points: int) -> np.ndarray:
    """`n_points` of the surface voxels (M, 3), evenly by index; (0, 3) if there are none."""
    if len(centres) == 0:
        return centres
    return centres[np.arange(n_points, dtype=np.int64) * len(centres) // n_points]


def share(points: np.ndarray, turn: int, turns: int) -> np.ndarray:
    """Every `turns`-th of points (K, 3) from number `turn` mod `turns` on, ceil(K / turns) of them:
    those that one layer looks at."""
    n = len(points)
    return points[(turn % turns + turns * np.arange(-(-n // turns))) % max(1, n)]


def surface_errors(points: np.ndarray, cones: np.ndarray, scale: float) -> np.ndarray:
    """(N,) mean over points (K, 3) of d^2 / (d^2 + scale^2), d the distance to the nearest
    cone's surface of cones (N, C, 16); 1 without points. Geman & McClure 1987."""
    if len(points) == 0:
        return np.ones(len(cones))
    errors = []
    for particle in cones:
        nearest = np.abs(distances(points, particle)).min(1)
        errors.append(np.mean(nearest**2 / (nearest**2 + scale**2)))
    return np.array(errors)


def posture_errors(body: BodyModel, poses: np.ndarray) -> np.ndarray:
    """(N,) sum over the degrees of freedom of the squared distance of poses (N, D) from rest, in
    the body's posture sigmas."""
    return np.sum(((poses - body.rest_pose) / body.posture_sigma) ** 2, 1)


def total_errors(
    rig: CameraRig,
    cones: np.ndarray,
    maps: np.ndarray,
    points: np.ndarray,
    sampling: np.ndarray,
    pairs: Sequence[tuple[int, int]],
    config: FilterConfig,
) -> np.ndarray:
    """(N,) exponent of Song et al. eq. (16) with its sign put right, surface and overlap error and
    the two-sided term added once per camera. Cameras without a sample are replaced by the mean of
    the others."""
    errors = np.zeros(len(cones))
    seeing = np.zeros(len(cones))
    for camera, view in zip(rig, maps, strict=True):
        edge, n_edge, inner, n_inner = np.moveaxis(
            image_errors(camera, cones, view, sampling).sum(1), -1, 0
        )
        seen = (n_edge > 0) & (n_inner > 0)
        errors += np.where(
            seen,
            config.edge_weight * edge / np.maximum(n_edge, 1)
            + config.silhouette_weight * inner / np.maximum(n_inner, 1),
            0.0,
        )
        seeing += seen
    worst = config.edge_weight + config.silhouette_weight
    mean = np.where(seeing > 0, errors / np.maximum(seeing, 1), worst)
    if config.surface_weight > 0:
        mean = mean + config.surface_weight * surface_errors(points, cones, config.surface_scale)
    mean = mean + config.overlap_weight * overlap_errors(cones, pairs)
    if config.two_sided_weight > 0:
        mean = mean + config.two_sided_weight * uncovered_errors(rig, cones, points)
    return len(rig) * mean

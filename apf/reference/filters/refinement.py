"""Gauss-Newton steps of the estimate against voxels and observed points. Twin of refinement.cl."""

from __future__ import annotations

import numpy as np

from apf.body.jacobian import bone_point_jacobian, distance_jacobian
from apf.body.model import BodyModel
from apf.filters.config import POINT_SCALE, VOXEL_SCALE, FilterConfig, GaussNewtonFit
from apf.filters.refinement import VOXEL_STRENGTH, prior_deviation
from apf.likelihood.observations import PointObservations
from apf.reference.likelihood.keypoints import match_points, observed_positions
from psfs.cameras.camera import CameraRig


def refine(
    body: BodyModel,
    mean: np.ndarray,
    points: np.ndarray | None,
    config: FilterConfig,
    observed: tuple[CameraRig, PointObservations] | None = None,
    judge_last: bool = True,
    fit: GaussNewtonFit | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Fit a pose (D,) near the particles' `mean` (D,) to the surface points (K, 3) m and the
    observed points.

    It minimises VOXEL_STRENGTH mean(d^2 / (d^2 + VOXEL_SCALE^2)) of the voxels' distances d, and
    POINT_SCALE^2 sum(e^2 / (e^2 + POINT_SCALE^2)) of the distances e, in deviations, of observed
    points, plus the squared distance from `mean` in prior deviations: the best of the poses met in
    the steps of `fit`, by default `config.fit`. They weigh voxels by a scale that shrinks, so that
    those far from any cone pull first, and observed points likewise.

    judge_last: whether the pose after the last step may be the best one.

    Also return the matrix (D, D) of the last linear system, zero where nothing is refined.
    """
    fit = fit or config.fit
    if fit.steps == 0:
        return mean, np.zeros((body.n_dof, body.n_dof))
    prior = prior_deviation(body, config, fit) ** -2
    pose, best, least = mean, mean, np.inf
    for step, (reach, point_reach) in enumerate(fit.reaches):
        cost, matrix = np.sum(prior * (pose - mean) ** 2), np.diag(prior)
        vector = prior * (pose - mean)
        parts = []
        if points is not None and len(points):
            parts.append(_voxel_system(body, pose, points, reach))
        if observed is not None and len(observed[1]):
            parts.append(_point_system(body, pose, *observed, point_reach))
        for part_cost, weight, miss, rows in parts:
            weighted = rows * weight[:, None]
            cost, matrix = cost + part_cost, matrix + weighted.T @ rows
            vector = vector + weighted.T @ miss
        if cost < least and (judge_last or step < fit.steps):
            best, least = pose, cost
        if step < fit.steps:
            pose = np.clip(pose - np.linalg.solve(matrix, vector), body.lower, body.upper)
    return best, matrix


def _voxel_system(
    body: BodyModel, pose: np.ndarray, points: np.ndarray, reach: float
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Return the voxels' cost, weights (K,), distances (K,) and their derivatives (K, D)."""
    strength, scale = VOXEL_STRENGTH, VOXEL_SCALE
    distance, rows = distance_jacobian(body, pose, points)
    cost = float(strength * np.mean(distance**2 / (distance**2 + scale**2)))
    weight = strength / (len(points) * scale**2) / (1 + distance**2 / reach**2) ** 2
    return cost, weight, distance, rows


def _point_system(
    body: BodyModel,
    pose: np.ndarray,
    rig: CameraRig,
    observations: PointObservations,
    reach: float,
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Return the observed points' cost, and weights (2 N,), distances (2 N,) and derivatives
    (2 N, D) of both coordinates of each that is in front of its camera, as its own point or its
    partner, whichever misses less."""
    world = observed_positions(body, pose[None], observations)
    off, point, share = (of[0] for of in match_points(rig, world, observations, POINT_SCALE))
    seen = np.isfinite(off).all(1)
    off, point, camera = off[seen], point[seen], observations.camera[seen]
    moves = bone_point_jacobian(body, pose[None], observations.bone[point], world[:, point])[0]
    slopes = _pixel_slopes(rig, world[0, point], camera)
    scaled = slopes * observations.inverse_scale[seen][:, None, None]
    rows = np.einsum("nci,ndi->ncd", scaled, moves).reshape(-1, body.n_dof)
    weight = 1 / (1 + np.sum(off**2, 1) / reach**2) ** 2
    cost = float(POINT_SCALE**2 * share.sum())
    return cost, np.repeat(weight, 2), off.ravel(), rows


def _pixel_slopes(rig: CameraRig, points: np.ndarray, camera: np.ndarray) -> np.ndarray:
    """Return (N, 2, 3) how the pixels of points (N, 3) m in cameras (N,) move with them."""
    R, t, K = (np.stack([getattr(one, name) for one in rig])[camera] for name in "RtK")
    seen = np.einsum("nij,nj->ni", R, points) + t
    plane = seen[:, :2] / seen[:, 2:]
    turned = (R[:, :2] - plane[:, :, None] * R[:, 2:]) / seen[:, 2, None, None]
    return K[:, :2, :2] @ turned

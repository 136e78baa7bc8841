"""Gauss-Newton steps of the estimate against the surface voxels. Twin of refinement.cl."""

from __future__ import annotations

import numpy as np

from apf.body.jacobian import distance_jacobian
from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.filters.refinement import prior_deviation


def refined(
    body: BodyModel, mean: np.ndarray, points: np.ndarray, config: FilterConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose (D,) that fits the points (K, 3) m best, near the particles' `mean` (D,).

    It minimises strength mean(d^2 / (d^2 + scale^2)) plus its squared distance from `mean` in prior
    deviations: the best of the poses met in `steps` steps.

    The steps weigh voxels by a scale that shrinks from `reach` to `scale`, so that
    those far from any cone pull first (graduated non-convexity, Blake & Zisserman 1987).

    Also return the matrix (D, D) of the last linear system, zero where nothing is refined.
    """
    if config.refinement.steps == 0:
        return mean, np.zeros((body.n_dof, body.n_dof))
    prior = prior_deviation(body, config) ** -2
    if len(points) == 0:
        return mean, np.diag(prior)
    weight = config.refinement.strength / (len(points) * config.refinement.scale**2)
    pose, best, least, reach = mean, mean, np.inf, config.refinement.reach
    for step in range(config.refinement.steps + 1):
        distance, rows = distance_jacobian(body, pose, points)
        unexplained = np.mean(distance**2 / (distance**2 + config.refinement.scale**2))
        cost = config.refinement.strength * unexplained + np.sum(prior * (pose - mean) ** 2)
        if cost < least:
            best, least = pose, cost
        weighted = rows * (weight / (1 + distance**2 / reach**2) ** 2)[:, None]
        matrix = weighted.T @ rows + np.diag(prior)
        if step == config.refinement.steps:
            break
        vector = weighted.T @ distance + prior * (pose - mean)
        pose = np.clip(pose - np.linalg.solve(matrix, vector), body.lower, body.upper)
        reach = max(config.refinement.scale, reach * config.refinement.shrink)
    return best, matrix

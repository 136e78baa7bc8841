"""Gauss-Newton steps of the estimate against the surface voxels. Twin of refine.cl."""

from __future__ import annotations

import numpy as np

from apf.body import AXES, BodyModel
from apf.config import FilterConfig
from apf.reference.cones import distances, normals
from apf.reference.kinematics import bone_matrices, posed_cones

#: Kinds of influence of a degree of freedom on a cone, in the table `cone_moves`.
_SLIDES, _TURNS = 1, 2


def cone_moves(body: BodyModel) -> np.ndarray:
    """(C, D) uint8: 0 where a degree of freedom does not move a cone, 1 slides it, 2 turns it."""
    moves = np.zeros((len(body.cones), body.n_dof), np.uint8)
    for c, cone in enumerate(body.cones):
        bone = cone.bone
        while bone >= 0:
            for axis in body.bones[bone].axes:
                moves[c, axis.dof] = _SLIDES if AXES.index(axis.kind) < 3 else _TURNS
            bone = body.bones[bone].parent
    return moves


def prior_deviation(body: BodyModel, config: FilterConfig) -> np.ndarray:
    """(D,) how far the refined pose may be from the particles' mean."""
    return np.maximum(config.refine_width * config.noise * body.sigma, 1e-6)


def hinges(body: BodyModel, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World axes (D, 3), with their signs, of all degrees of freedom, and points (D, 3) on them.

    Found by moving one axis after the other: the frame in which axis k of a bone acts is the
    bone's with all later axes at zero.
    """
    directions, places = np.zeros((body.n_dof, 3)), np.zeros((body.n_dof, 3))
    for b, bone in enumerate(body.bones):
        for k, axis in enumerate(bone.axes):
            partial = pose.copy()
            partial[[later.dof for later in bone.axes[k:]]] = 0.0
            rotations, origins = bone_matrices(body, partial[None])
            directions[axis.dof] = axis.sign * rotations[0, b, :, AXES.index(axis.kind) % 3]
            places[axis.dof] = origins[0, b]
    return directions, places


def distance_rows(
    body: BodyModel, pose: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distances (K,) of points (K, 3) to the nearest cone of `pose` (D,), and their derivatives
    (K, D). A turn by d about an axis a through o moves the cone at p by d (a x (p - o))."""
    cones = posed_cones(body, pose[None])[0]
    every = distances(points, cones)
    nearest = np.abs(every).argmin(1)
    normal = normals(points, cones[nearest])
    directions, places = hinges(body, pose)
    arms = np.cross(directions, points[:, None] - places)
    moves = cone_moves(body)[nearest]
    motion = np.where((moves == _SLIDES)[..., None], directions, arms)
    rows = -np.einsum("kc,kdc->kd", normal, motion) * (moves > 0)
    return every[np.arange(len(points)), nearest], rows


def refined(
    body: BodyModel, mean: np.ndarray, points: np.ndarray, config: FilterConfig
) -> tuple[np.ndarray, np.ndarray]:
    """The pose (D,) that minimises strength mean(d^2 / (d^2 + scale^2)) plus its squared distance
    from `mean` in prior deviations: the best of the poses met in `refine_steps` steps.

    The steps weigh voxels by a scale that shrinks from `refine_reach` to `refine_scale`, so that
    those far from any cone pull first (graduated non-convexity, Blake & Zisserman 1987).

    Also the matrix (D, D) of the last linear system, zero where nothing is refined.
    """
    if config.refine_steps == 0:
        return mean, np.zeros((body.n_dof, body.n_dof))
    prior = prior_deviation(body, config) ** -2
    if len(points) == 0:
        return mean, np.diag(prior)
    weight = config.refine_strength / (len(points) * config.refine_scale**2)
    pose, best, least, reach = mean, mean, np.inf, config.refine_reach
    for step in range(config.refine_steps + 1):
        distance, rows = distance_rows(body, pose, points)
        unexplained = np.mean(distance**2 / (distance**2 + config.refine_scale**2))
        cost = config.refine_strength * unexplained + np.sum(prior * (pose - mean) ** 2)
        if cost < least:
            best, least = pose, cost
        weighted = rows * (weight / (1 + distance**2 / reach**2) ** 2)[:, None]
        matrix = weighted.T @ rows + np.diag(prior)
        if step == config.refine_steps:
            break
        vector = weighted.T @ distance + prior * (pose - mean)
        pose = np.clip(pose - np.linalg.solve(matrix, vector), body.lower, body.upper)
        reach = max(config.refine_scale, reach * config.refine_shrink)
    return best, matrix

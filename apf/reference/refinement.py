"""Gauss-Newton steps of the estimate against the surface voxels. Twin of refinement.cl."""

from __future__ import annotations

import numpy as np

from apf.body.model import AXES, BodyModel
from apf.filters.config import FilterConfig
from apf.reference.cones import distances, normals
from apf.reference.kinematics import axis_rotation, bone_matrices, posed_cones

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
    """World axes (D, 3), with their signs, of all degrees of freedom, and points (D, 3) on them."""
    directions, places = np.zeros((2, body.n_dof, 3))
    rotations, origins = bone_matrices(body, pose[None])
    for bone in body.bones:
        rotation, origin = np.eye(3), bone.offset
        if bone.parent >= 0:
            rotation = rotations[0, bone.parent]
            origin = origins[0, bone.parent] + rotation @ bone.offset
        rotation = rotation @ bone.rest
        for axis in bone.axes:
            kind, value = AXES.index(axis.kind), axis.sign * pose[axis.dof]
            directions[axis.dof] = axis.sign * rotation[:, kind % 3]
            places[axis.dof] = origin
            if kind < 3:
                origin = origin + rotation[:, kind] * value
            else:
                rotation = rotation @ axis_rotation(kind - 3, value)
    return directions, places


def motions(
    body: BodyModel, pose: np.ndarray, cone: np.ndarray, points: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """(D, K) how far each degree of freedom moves points (K, 3) that are fixed to the cones
    numbered `cone` (K,) along `normal` (K, 3). A turn by d about an axis a through o moves the
    point p by d (a x (p - o))."""
    directions, places = hinges(body, pose)
    slides = directions @ normal.T
    turns = directions @ np.cross(points, normal).T - np.cross(directions, places) @ normal.T
    moves = cone_moves(body)[cone].T
    return np.where(moves == _SLIDES, slides, np.where(moves == _TURNS, turns, 0.0))


def distance_rows(
    body: BodyModel, pose: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distances (K,) of points (K, 3) to the nearest cone of `pose` (D,), and their derivatives
    (K, D)."""
    cones = posed_cones(body, pose[None])[0]
    every = distances(points, cones)
    nearest = np.abs(every).argmin(1)
    rows = -motions(body, pose, nearest, points, normals(points, cones[nearest])).T
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

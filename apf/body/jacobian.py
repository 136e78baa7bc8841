"""Derivatives of points on the body, and of distances to it, with respect to the pose.

World matrices by Rymut 2016 eq. (4.18)-(4.21): the world axis of a degree of freedom depends on the
bones above it and on the bone's earlier axes.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from apf.body.cones import cone_normals
from apf.body.kinematics import bone_matrices, posed_cones
from apf.body.model import AXES, BodyModel
from psfs.common.cones import cone_distances

#: Codes in the table `cone_moves` for how a degree of freedom moves a cone.
_SLIDES, _TURNS = 1, 2


@lru_cache(maxsize=8)  # a body is posed in many frames
def bone_moves(body: BodyModel) -> np.ndarray:
    """Return (B, D) uint8: 0 if a degree of freedom does not move a bone, 1 if it translates, 2 if
    it rotates it. The array is cached: do not write to it."""
    moves = np.zeros((len(body.bones), body.n_dof), np.uint8)
    for b, bone in enumerate(body.bones):
        if bone.parent >= 0:
            moves[b] = moves[bone.parent]
        for axis in bone.axes:
            moves[b, axis.dof] = _SLIDES if AXES.index(axis.kind) < 3 else _TURNS
    return moves


def cone_moves(body: BodyModel) -> np.ndarray:
    """Return (C, D) uint8, how each degree of freedom moves each cone, see `bone_moves`."""
    return bone_moves(body)[[cone.bone for cone in body.cones]]


def world_axes(body: BodyModel, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the world axes (..., D, 3), with their signs, of the degrees of freedom in poses (...,
    D).

    Also returns a point (..., D, 3) m on each axis.
    """
    poses = np.asarray(pose, np.float64).reshape(-1, body.n_dof)
    axes = np.zeros((2, *poses.shape, 3))
    bone_matrices(body, poses, axes)
    directions, anchors = axes.reshape(2, *np.shape(pose), 3)
    return directions, anchors


def bone_point_jacobian(
    body: BodyModel,
    poses: np.ndarray,
    bone: np.ndarray,
    points: np.ndarray,
    axes: np.ndarray | None = None,
) -> np.ndarray:
    """Return the derivatives (M, P, D, 3) of points with respect to poses (M, D).

    points: (M, P, 3) m, fixed to the bones with indices `bone` (P,). axes: (2, M, D, 3) from
    `bone_matrices`, if they are known.
    """
    directions, anchors = world_axes(body, poses) if axes is None else axes
    moves = bone_moves(body)[bone][:, :, None]
    turns = cross_rows(directions[:, None], points[:, :, None] - anchors[:, None])
    return np.where(moves == _SLIDES, directions[:, None], np.where(moves == _TURNS, turns, 0.0))


def cone_motions(body: BodyModel, axes: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return (M, C, D, 6), how each degree of freedom moves the cones in M poses whose `axes`
    `world_axes` returns: the product with a point's direction n (3,) and with p x n, p the point on
    the cone, is the point's displacement along n: a rotation by d about an axis a through o moves
    p by d (a x (p - o))."""
    directions, anchors = (rows[:, None] for rows in axes)
    moves = cone_moves(body)[..., None]
    turns = (moves == _TURNS).astype(float)
    lever = np.where(moves == _SLIDES, directions, -turns * cross_rows(directions, anchors))
    return np.concatenate([lever, turns * directions], axis=-1)


def cross_rows(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross products (..., 3) of vectors (..., 3), bitwise equal to `np.cross`, which
    takes several times as long for some hundred of them."""
    ax, ay, az, bx, by, bz = (rows[..., k] for rows in (a, b) for k in range(3))
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], -1)


def distance_jacobian(
    body: BodyModel, pose: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances (K,) m of points (K, 3) m to the nearest cone of `pose` (D,).

    Also returns their derivatives (K, D).
    """
    cones = posed_cones(body, pose[None])[0]
    every = cone_distances(points, cones)
    nearest = np.abs(every).argmin(1)
    bones = np.array([cone.bone for cone in body.cones])[nearest]
    moves = bone_point_jacobian(body, pose[None], bones, points[None])[0]
    rows = -np.einsum("kda,ka->kd", moves, cone_normals(points, cones[nearest]))
    return every[np.arange(len(points)), nearest], rows

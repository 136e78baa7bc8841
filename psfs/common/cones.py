"""Distances to tapered cones, the parts of a tracked body.

A cone is 16 floats: A (3), radius at A, B (3), radius at B, X / sx (3), 0, Y / sy (3), 0, where A,
B are the end centres and X, Y the unit axes of the elliptic section with the scales sx, sy. Also
the float64 specification of `cone_distance` in cones.h and `ray_distance` in body_location.cl.
"""

from __future__ import annotations

import numpy as np

#: Floats of a cone.
CONE_FLOATS = 16


def cone_distances(points: np.ndarray, cones: np.ndarray) -> np.ndarray:
    """Return signed distances (..., N, C) m from points (..., N, 3) to the surfaces of cones (...,
    C, 16).

    Measured in the frame where the elliptic section is a circle: exact for round cones except for
    their taper; the ends are rounded. Negative inside.
    """
    a = cones[..., 0:3]
    axis = cones[..., 4:7] - a
    length = np.linalg.norm(axis, axis=-1)
    ways = np.stack([cones[..., 8:11], cones[..., 12:15], axis / length[..., None]])
    x, y, z = points @ ways.swapaxes(-2, -1) - dot(ways, a)[..., None, :]
    length, radius, end = (v[..., None, :] for v in (length, cones[..., 3], cones[..., 7]))
    t = np.clip(z / length, 0.0, 1.0)
    z -= t * length
    distance = np.sqrt(x * x + y * y + z * z)
    return np.asarray(distance - (radius + t * (end - radius)))


def ray_cone_distances(origin: np.ndarray, rays: np.ndarray, cones: np.ndarray) -> np.ndarray:
    """Return signed distances (N, C) m from the lines through `origin` (3,) along rays (N, 3) to
    the surfaces of cones (C, 16), measured as `cone_distances` measures."""
    a = cones[:, 0:3]
    axis = cones[:, 4:7] - a
    length = np.linalg.norm(axis, axis=-1)
    frame = np.stack([cones[:, 8:11], cones[:, 12:15], axis / length[:, None]], 1)
    start = np.einsum("cij,cj->ci", frame, origin - a)
    along = np.einsum("cij,nj->nci", frame, rays)
    across = np.maximum((along[..., :2] ** 2).sum(-1), 1e-12)
    nearest = -(start[:, :2] * along[..., :2]).sum(-1) / across
    t = np.clip((start[:, 2] + nearest * along[..., 2]) / length, 0.0, 1.0)
    end = start - np.stack([0 * t, 0 * t, t * length], -1)
    left = end - (dot(end, along) / dot(along, along))[..., None] * along
    return np.linalg.norm(left, axis=-1) - (cones[:, 3] + t * (cones[:, 7] - cones[:, 3]))


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the scalar products (..) of vectors (.., 3); `np.sum` over three numbers is four times
    slower."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def largest_slopes(cones: np.ndarray) -> np.ndarray:
    """Return (C,): the most that the distance to each of the cones (C, 16) changes per metre."""
    across = np.linalg.norm([cones[:, 8:11], cones[:, 12:15]], axis=-1).max(0, initial=1.0)
    length = np.linalg.norm(cones[:, 4:7] - cones[:, 0:3], axis=-1)
    return across + np.abs(cones[:, 7] - cones[:, 3]) / length

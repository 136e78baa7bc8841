"""Outlines of tapered cones in a picture, distances to them, and their overlap.

Also the float64 specification of cones.h and packed_cones.h.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from apf.body.kinematics import posed_cones
from apf.body.model import BodyModel
from psfs.cameras.camera import Camera
from psfs.common.cones import cone_distances, dot

#: Corners further out than this, px, count as unseen: float interpolation would displace the lines
#: between them by more than a hundredth of a pixel, and at 1e9 px by whole pictures.
FAR_OUT = 1e5
#: Spheres along a cone.
ALONG = 4
#: Points of a drawn outline about one end of a cone.
_RING = 24


def outline_corners(eye: np.ndarray, cones: np.ndarray) -> np.ndarray:
    """Return world corners (..., 4, 3) of the outline trapezoids of cones (..., 16) seen from `eye`
    (3,) m.

    Kwolek & Rymut 2016 section 3: the side vector is normal to the axis and to the viewing ray; in
    the frame where the elliptic section is a circle it is `normalize(axis x (A - eye))`. Corners in
    order A + s, A - s, B - s, B + s. If the axis points at the eye, any normal is used.
    """
    a, b = cones[..., 0:3], cones[..., 4:7]
    x, y = cones[..., 8:11], cones[..., 12:15]  # unit axes over their scales
    to_eye = eye - a
    ex, ey = np.sum(to_eye * x, -1), np.sum(to_eye * y, -1)
    norm = np.hypot(ex, ey)
    ex, ey = (
        np.where(norm > 1e-9, component / np.maximum(norm, 1e-9), default)
        for component, default in ((ex, 0.0), (ey, 1.0))
    )
    # Transform back from the circular section: X sx = x / |x|^2.
    x, y = x / np.sum(x * x, -1, keepdims=True), y / np.sum(y * y, -1, keepdims=True)
    side = -ey[..., None] * x + ex[..., None] * y
    ra, rb = cones[..., 3:4], cones[..., 7:8]
    return np.stack([a + ra * side, a - ra * side, b - rb * side, b + rb * side], -2)


def project_outlines(camera: Camera, cones: np.ndarray) -> np.ndarray:
    """Project the outline corners (..., 4, 2) px; NaN for a cone with an unseen corner."""
    pixels, depth = camera.project(outline_corners(camera.centre, cones))
    visible = np.all((depth > 0) & (np.abs(pixels) < FAR_OUT).all(-1), axis=-1)
    return np.where(visible[..., None, None], pixels, np.nan)


def outline_rings(eye: np.ndarray, cones: np.ndarray) -> np.ndarray:
    """Return points (..., 2 R, 3) on the round ends of cones (..., 16) seen from `eye` (3,) m,
    whose convex hull in a picture is the outline of the cone with these ends."""
    ends = cones[..., :8].reshape(*cones.shape[:-1], 2, 4)
    axis = ends[..., 1, :3] - ends[..., 0, :3]
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    x, y = cones[..., 8:11], cones[..., 12:15]
    angles = np.linspace(0, 2 * np.pi, _RING, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], -1)
    # where the end is a ball, its outline is a circle across the line of sight
    to_eye = eye - ends[..., :3]
    sight = np.stack([(to_eye * side[..., None, :]).sum(-1) for side in (axis, x, y)], -1)
    across = np.linalg.svd(sight[..., None, :])[2][..., 1:, :]
    back = np.stack([axis, x / dot(x, x)[..., None], y / dot(y, y)[..., None]], -2)
    rings = ends[..., None, 3:] * (circle @ across) @ back[..., None, :, :]
    rings += ends[..., None, :3]
    return rings.reshape(*cones.shape[:-1], 2 * _RING, 3)


def cone_normals(points: np.ndarray, cones: np.ndarray) -> np.ndarray:
    """Return unit gradients (N, 3) of the distances of points (N, 3), each to its cone (N, 16)."""
    a, b = cones[:, 0:3], cones[:, 4:7]
    x, y = cones[:, 8:11], cones[:, 12:15]
    axis = b - a
    length2 = dot(axis, axis)[:, None]
    offset = points - a
    along = dot(offset, axis)[:, None] / length2
    beyond = along - np.clip(along, 0.0, 1.0)
    u, v = dot(offset, x)[:, None], dot(offset, y)[:, None]
    distance = np.sqrt(u * u + v * v + beyond**2 * length2)
    normal = (u * x + v * y + beyond * axis) / np.maximum(distance, 1e-9)
    taper = (cones[:, 7:8] - cones[:, 3:4]) / length2 * axis
    return np.where(beyond == 0, normal - taper, normal)


def overlap_errors(cones: np.ndarray, pairs: Sequence[tuple[int, int]]) -> np.ndarray:
    """Return (N,) how deeply parts that must not meet overlap, 0 to 1.

    The mean of (overlap / radius)^2, at most 1 each, over `pairs` (first, second cone) of cones (N,
    C, 16) and over three points on the first one's axis.
    """
    if not pairs:
        return np.zeros(len(cones))
    first, second = np.repeat(np.array(pairs), 3, axis=0).T
    t = np.tile([0.0, 0.5, 1.0], len(pairs))
    errors = []
    for posed in cones:
        a = posed[first]
        points = a[:, 0:3] + t[:, None] * (a[:, 4:7] - a[:, 0:3])
        radius = a[:, 3] + t * (a[:, 7] - a[:, 3])
        distance = cone_distances(points, posed)[np.arange(len(t)), second]
        errors.append(np.mean(np.clip(1 - distance / radius, 0, 1) ** 2))
    return np.array(errors)


def count_spheres(body: BodyModel) -> int:
    """Return the number of a body's spheres."""
    return len(body.cones) * ALONG


def body_spheres(body: BodyModel, pose: np.ndarray) -> np.ndarray:
    """Return spheres (C * ALONG, 4), centres and radii, m, along the cones of `body` in `pose`
    (D,)."""
    cones = posed_cones(body, pose[None])[0]
    share = np.linspace(0, 1, ALONG)[:, None]
    start, end = cones[:, None, 0:4], cones[:, None, 4:8]
    return np.asarray((start + share * (end - start)).reshape(-1, 4))

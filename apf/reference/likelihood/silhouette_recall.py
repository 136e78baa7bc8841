"""Share of the silhouettes that the body leaves uncovered. Twin of silhouette_recall.cl."""

from __future__ import annotations

import numpy as np

from apf.body.cones import project_outlines
from psfs.cameras.camera import CameraRig


def uncovered_errors(rig: CameraRig, cones: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return (N,) the share of the silhouettes that the body leaves uncovered, by its cones.

    The mean over the cameras of the share of points (K, 3) m in their pictures that lie in no
    trapezoid of cones (N, C, 16); cameras that see no point are left out, 1 if none sees any.
    """
    shares = []
    for camera in rig:
        seen = camera.project(points[camera.look_up(points)[0]])[0]
        if len(seen):
            corners = project_outlines(camera, cones)
            shares.append([1 - find_covered(one, seen).mean() for one in corners])
    return np.mean(shares, axis=0) if shares else np.ones(len(cones))


def find_covered(corners: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return (K,) whether pixels (K, 2) lie in any of the trapezoids (C, 4, 2); one with NaN
    corners holds none."""
    edges = np.roll(corners, -1, axis=1) - corners
    away = pixels[:, None, None] - corners  # (K, C, 4, 2)
    side = edges[..., 0] * away[..., 1] - edges[..., 1] * away[..., 0]
    inside = (side > 0).all(-1) | (side < 0).all(-1)
    return inside.any(-1)

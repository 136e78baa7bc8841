"""The points of the floor that each camera sees: their light is the same for all cameras."""

from __future__ import annotations

import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import cell_rays, cells, intersect_axes
from psfs.silhouettes.config import FloorConfig


def floor_points(rig: CameraRig, config: FloorConfig) -> np.ndarray:
    """Return x and y (V, rows, columns, 2), m, of the floor point in the middle of each cell; NaN
    where it shows no floor, and everywhere if `config.on` is false.

    The floor is the circle around the point that the cameras look at, with the distance of the
    farthest camera as its radius.
    """
    middle = intersect_axes(rig)[:2]
    radius = np.linalg.norm(rig.centres[:, :2] - middle, axis=1).max()
    points = np.full((len(rig), *cells(rig), 2), np.nan)
    if not config.on:
        return points
    for own, camera, rays in zip(points, rig, cell_rays(rig), strict=True):
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (config.height - camera.centre[2]) / rays[..., 2]
            hits = camera.centre[:2] + distance[..., None] * rays[..., :2]
            near = (np.linalg.norm(hits - middle, axis=-1) < radius) & (distance > 0)
        own[near] = hits[near]
    return points

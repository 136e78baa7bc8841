"""A tracked body as a prior of the voxels' occupancy and of the silhouettes. Twin of body_prior.h
and body_location.cl."""

from __future__ import annotations

import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.cameras.cells import cell_rays
from psfs.common.cones import cone_distances, ray_cone_distances
from psfs.voxels.body_prior import body_counts, location_counts
from psfs.voxels.config import BodyPriorConfig

#: Points whose distances to all cones are computed at once.
_LOT = 2**15


def body_evidence(
    points: np.ndarray, cones: np.ndarray, config: BodyPriorConfig, step: float
) -> np.ndarray:
    """Return the counts (N,) of `step` nats that a body with cones (C, 16), NaN where they are
    unknown, adds to voxels at `points` (N, 3) m."""
    inside, outside, known = body_counts(config, cones, step)
    nearest = np.full(len(points), np.inf)
    if len(known):
        for first in range(0, len(points), _LOT):
            lot = slice(first, first + _LOT)
            nearest[lot] = cone_distances(points[lot], known).min(1)
    within = np.clip((config.distance - nearest) / (config.distance + config.depth), 0, 1)
    return np.rint(outside + within * (inside - outside))


def body_location(
    rig: CameraRig, cones: np.ndarray, config: BodyPriorConfig, steps: float
) -> np.ndarray | None:
    """Return the location prior (V, rows, columns) int8, counts of 1 / `steps` nats, of a body with
    cones (C, 16), NaN where they are unknown; None if all are."""
    inside, outside, slope = location_counts(config, cones, steps)
    known = cones[np.isfinite(cones).all(-1)]
    if not len(known):
        return None
    odds = []
    for camera, rays in zip(rig, cell_rays(rig), strict=True):
        distances = ray_cone_distances(camera.centre, rays.reshape(-1, 3), known)
        nearest = np.nan_to_num(distances, nan=np.inf).min(1).reshape(rays.shape[:2])
        odds.append(np.rint(np.clip((config.edge - nearest) * slope, outside, inside)))
    return np.stack(odds).astype(np.int8)

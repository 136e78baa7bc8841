"""A tracked body as a prior of the voxels' occupancy and of the silhouettes. Twin of body_prior.h
and body_location.cl."""

from __future__ import annotations

import numpy as np

from psfs.cameras.camera import BLOCK, CameraRig
from psfs.cameras.rig_geometry import cell_rays
from psfs.common.cones import cone_distances, ray_cone_distances
from psfs.voxels.body_prior import (
    EDGE,
    LOW_WIDTH,
    WIDTH,
    body_counts,
    find_low_cones,
    location_counts,
)
from psfs.voxels.config import ReconstructionConfig


def body_evidence(points: np.ndarray, cones: np.ndarray, step: float) -> np.ndarray:
    """Return the counts (N,) of `step` nats that a body with cones (C, 16), NaN where they are
    unknown, adds to voxels at `points` (N, 3) m."""
    inside, outside, known = body_counts(cones, step)
    nearest = np.full(len(points), np.inf)
    if len(known):
        for first in range(0, len(points), BLOCK):
            lot = slice(first, first + BLOCK)
            nearest[lot] = cone_distances(points[lot], known).min(1)
    within = np.clip((EDGE - nearest) / (2 * EDGE), 0, 1)
    return np.rint(outside + within * (inside - outside))


def body_location(
    rig: CameraRig, cones: np.ndarray, config: ReconstructionConfig
) -> np.ndarray | None:
    """Return the location prior (V, rows, columns) int8, counts of `ratio_steps`, of a body with
    cones (C, 16), NaN where they are unknown, None if all are."""
    steps = config.silhouette.evidence.ratio_steps
    inside, outside = location_counts(cones, steps)
    known = cones[np.isfinite(cones).all(-1)]
    odds: list[np.ndarray] = []
    if not len(known):
        return None
    low = find_low_cones(known, config.silhouette.floor.height)
    for camera, rays in zip(rig, cell_rays(rig), strict=True):
        distances = ray_cone_distances(camera.centre, rays.reshape(-1, 3), known)
        distances = np.nan_to_num(distances, nan=np.inf)
        width = np.where(low & (distances < 0), LOW_WIDTH, WIDTH)
        counts = (-steps * distances / width).max(1)
        odds.append(np.rint(np.clip(counts, outside, inside)).reshape(rays.shape[:2]))
    return np.stack(odds).astype(np.int8)

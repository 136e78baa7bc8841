"""A tracked body as a prior of the voxels' occupancy. Twin of body_prior.h."""

from __future__ import annotations

import numpy as np

from psfs.common.cones import cone_distances
from psfs.voxels.body_prior import body_counts
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

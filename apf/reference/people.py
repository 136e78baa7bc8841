"""The NumPy twin of `apf.tracking.places.Places`."""

from __future__ import annotations

import numpy as np

from apf.body.kinematics import posed_cones
from apf.body.model import BodyModel


def expect_spheres(
    body: BodyModel, newest: np.ndarray, before: np.ndarray, ahead: float, along: int
) -> np.ndarray:
    """Return spheres (C * along, 4), centres and radii, m, along the cones of `body` in the pose
    `newest` (D,), moved `ahead` times as they moved since the pose `before` (D,)."""
    cones = posed_cones(body, np.stack([newest, before]))
    share = np.linspace(0, 1, along)[:, None]
    start, end = cones[:, :, None, 0:4], cones[:, :, None, 4:8]
    here, there = start + share * (end - start)
    return np.asarray((here + ahead * (here - there)).reshape(-1, 4))

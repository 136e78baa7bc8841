"""The NumPy twin of `apf.tracking.together.ExpectedBodies`."""

from __future__ import annotations

import numpy as np

from apf.body.model import BodyModel
from apf.body.spheres import body_spheres


def expect_spheres(
    body: BodyModel, newest: np.ndarray, before: np.ndarray, ahead: float
) -> np.ndarray:
    """Return spheres (K, 4), centres and radii, m, along the cones of `body` in the pose `newest`
    (D,), moved `ahead` times as they moved since the pose `before` (D,)."""
    here, there = body_spheres(body, newest), body_spheres(body, before)
    return here + ahead * (here - there)

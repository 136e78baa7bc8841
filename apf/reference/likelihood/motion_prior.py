"""How far poses are from what is expected after the last frame. Twin of motion_prior.cl."""

from __future__ import annotations

import numpy as np

from apf.body.model import BodyModel
from apf.likelihood.config import MotionPriorConfig
from apf.likelihood.motion_prior import change_factors


def motion_errors(
    body: BodyModel, poses: np.ndarray, expected: np.ndarray, config: MotionPriorConfig
) -> np.ndarray:
    """Return (N,) the mean over the degrees of freedom of the squared distance of poses (N, D) from
    the one `expected` (D,), in sigmas; 0 where that is NaN."""
    if np.isnan(expected).any():
        return np.zeros(len(poses))
    return np.sum((change_factors(body, config) * (poses - expected)) ** 2, 1)


def expectation(motion: np.ndarray, pose: np.ndarray, velocity: float) -> np.ndarray:
    """Return the last estimate and what is expected next (D, 2) after a frame that ends with `pose`
    (D,), of what they were before it; NaN for none."""
    last = motion[:, 0]
    change = np.where(np.isnan(last), 0.0, pose - last)
    return np.stack([pose, pose + velocity * change], -1)

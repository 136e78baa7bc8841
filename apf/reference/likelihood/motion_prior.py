"""How far poses are from what is expected after the last frame. Twin of motion_prior.cl."""

from __future__ import annotations

import numpy as np

from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.likelihood.motion_prior import jump_scales


def jump_errors(
    body: BodyModel, poses: np.ndarray, expected: np.ndarray, config: FilterConfig
) -> np.ndarray:
    """Return (N,) the mean over the degrees of freedom of the squared distance of poses (N, D) from
    the one `expected` (D,), in sigmas; 0 where that is NaN."""
    if np.isnan(expected).any():
        return np.zeros(len(poses))
    return np.sum((jump_scales(body, config) * (poses - expected)) ** 2, 1)


def expectation(motion: np.ndarray, pose: np.ndarray, velocity: float) -> np.ndarray:
    """Return the last estimate and what is expected next (D, 2) after a frame that ends with `pose`
    (D,), of what they were before it; NaN for none."""
    last = motion[:, 0]
    change = np.where(np.isnan(last), 0.0, pose - last)
    return np.stack([pose, pose + velocity * change], -1)

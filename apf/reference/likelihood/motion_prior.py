"""Distance of poses from the expected pose. Twin of motion_prior.cl."""

from __future__ import annotations

import numpy as np

from apf.body.model import BodyModel
from apf.likelihood.motion_prior import change_factors
from apf.likelihood.term import SharedTwin, TermTwin
from apf.likelihood.terms.motion_prior import MotionPriorConfig


def motion_errors(
    body: BodyModel, poses: np.ndarray, expected: np.ndarray, config: MotionPriorConfig
) -> np.ndarray:
    """Return (N,) the mean over the degrees of freedom of the squared distance of poses (N, D) from
    the one `expected` (D,), in sigmas; 0 where that is NaN."""
    if np.isnan(expected).any():
        return np.zeros(len(poses))
    return np.sum((change_factors(body, config) * (poses - expected)) ** 2, 1)


def expectation(motion: np.ndarray, pose: np.ndarray, velocity: float) -> np.ndarray:
    """Return the last estimate and the expected pose (D, 2) after a frame whose estimate is `pose`
    (D,); `motion` holds both before the frame, NaN for none."""
    last = motion[:, 0]
    change = np.where(np.isnan(last), 0.0, pose - last)
    return np.stack([pose, pose + velocity * change], -1)


class NumpyMotionPrior(TermTwin):
    """The term in NumPy; `motion` (D, 2): last estimate and expected pose."""

    def __init__(self, shared: SharedTwin, settings: MotionPriorConfig) -> None:
        self._body, self._velocity = shared.scene.body, shared.velocity
        self._settings = settings
        self.forget()

    def forget(self) -> None:
        self.motion = np.full((self._body.n_dof, 2), np.nan)

    def learn(self, pose: np.ndarray) -> None:
        self.motion = expectation(self.motion, pose, self._velocity)

    def errors(self, poses: np.ndarray) -> np.ndarray:
        return motion_errors(self._body, poses, self.motion[:, 1], self._settings)

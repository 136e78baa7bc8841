"""A likelihood whose minimum is known, for the tests of the searches."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from apf.body.model import BodyModel
from apf.likelihood.base import Likelihood
from apf.reference.likelihood.base import NumpyLikelihood
from cl import Array, Device


class Distance(Likelihood, NumpyLikelihood):
    """Errors that are the distance of poses from the observed one, in sigmas; on the host, between
    a device's commands, or called as a twin."""

    def __init__(self, device: Device | None, body: BodyModel, n_particles: int) -> None:
        self.scale = np.maximum(body.sigma, 1e-9) * np.sqrt(body.n_dof)
        self.target = body.rest_pose
        self.calls = 0
        if device is not None:
            self.errors: Any = device.empty((n_particles,), np.float32)

    def observe(self, observation: np.ndarray) -> None:
        self.target = observation

    def __call__(self, poses: np.ndarray) -> np.ndarray:
        self.calls += 1
        return np.linalg.norm((poses - self.target) / self.scale, axis=1) / 10

    def launcher(self, poses: Array) -> list[Callable[[], None]]:
        return [lambda: self.errors.set(self(poses.get()).astype(np.float32))]

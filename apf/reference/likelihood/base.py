"""Base class of the likelihoods in NumPy. Twin of apf/likelihood/base.py."""

from __future__ import annotations

from typing import Any

import numpy as np

from apf.likelihood.observations import PointObservations
from psfs.cameras.camera import CameraRig


class NumpyLikelihood:
    """Likelihood in NumPy, twin of `apf.likelihood.base.Likelihood`. A subclass implements
    `observe(observation)` and a call with poses (N, D), which returns their errors (N,).

    points: (K, 3) surface points, m, that estimates are fitted to; None: there are none. turn:
    number of the device tracker's launcher that a call stands for. observed: cameras and observed
    points that estimates are fitted to; None: there are none. unit: see `Likelihood`.
    """

    points: np.ndarray | None = None
    turn: int = 0
    observed: tuple[CameraRig, PointObservations] | None = None
    unit: float = 1.0

    def observe(self, observation: Any) -> None:
        """Take an observation."""
        raise NotImplementedError

    def __call__(self, poses: np.ndarray) -> np.ndarray:
        """Return the errors (N,) of poses (N, D)."""
        raise NotImplementedError

    def rescore(self, poses: np.ndarray, stride: int, least_recall: float = 0.0) -> np.ndarray:
        """Return errors (N,) of poses (N, D), see `Likelihood.rescoring_launcher`."""
        raise NotImplementedError

    def misfit(self, pose: np.ndarray) -> float:
        """Return the misfit of a pose (D,), see `Likelihood`; NaN if the likelihood has none."""
        return float("nan")

    def learn(self, pose: np.ndarray) -> None:
        """Update the learned models after a frame whose estimate is `pose` (D,)."""

    def forget(self) -> None:
        """Reset the learned models before a new track."""

"""Base class of the likelihoods in NumPy. Twin of apf/likelihood/base.py."""

from __future__ import annotations

from typing import Any

import numpy as np

from apf.likelihood.observations import PointObservations
from psfs.cameras.camera import CameraRig


class NumpyLikelihood:
    """Likelihood in NumPy, twin of `apf.likelihood.base.Likelihood`. A subclass implements
    `observe(observation)` and a call with poses (N, D), which returns their errors (N,).

    points: (K, 3) surface points, m, that estimates are refined on; None: they are not. turn: which
    of the launchers that a device's tracker makes is meant. observed: cameras and the points of
    the body that estimates are refined on; None: on none. unit: see `Likelihood`.
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
        """Return how badly a pose (D,) fits, in absolute terms; NaN where that is not known."""
        return float("nan")

    def learn(self, pose: np.ndarray) -> None:
        """Learn from a frame whose estimate is `pose` (D,)."""

    def forget(self) -> None:
        """Forget what was learnt: a new track begins."""

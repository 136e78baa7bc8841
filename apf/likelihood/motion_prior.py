"""How far poses are from what is expected after the last frame (kernel: motion_prior.cl)."""

from __future__ import annotations

from typing import Any

import numpy as np

from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from cl import Array, Device, Launch


class Smoothness:
    """A prior on the change from frame to frame: its squared length in the body's sigmas.

    It is counted from the last estimate, or with `FilterConfig.velocity` from where the pose is
    expected next. `motion` (D, 2) float32 holds both; NaN before there is an estimate, which costs
    nothing.
    """

    def __init__(self, device: Device, body: BodyModel, config: FilterConfig) -> None:
        self.device, self.config = device, config
        self._n_dof = body.n_dof
        self._scales = device.to_device(jump_scales(body, config).astype(np.float32))
        self.motion = device.empty((body.n_dof, 2), np.float32, "the expected pose")
        self.forget()

    def forget(self) -> None:
        """Nothing is expected any more."""
        self.motion.fill(np.nan)

    def launcher(self, poses: Array, weight: float, errors: Array) -> list[Launch]:
        """The launches that add to `errors` (n,) of `poses` (n, D) `weight` times the mean over
        their degrees of freedom of the squared change, in sigmas."""
        return [
            self.device.launch(
                self._kernel("add_jumps"),
                (poses.shape[0],),
                None,
                n=poses.shape[0],
                weight=weight,
                scales=self._scales,
                motion=self.motion,
                poses=poses,
                errors=errors,
            )
        ]

    def learning_launcher(self, pose: Array) -> list[Launch]:
        """The launches that take the first of `pose` (.., D) for the frame's."""
        return [
            self.device.launch(
                self._kernel("expect"),
                (self._n_dof,),
                None,
                velocity=self.config.velocity,
                pose=pose,
                motion=self.motion,
            )
        ]

    def _kernel(self, name: str) -> Any:
        return self.device.kernel("tracking/motion_prior", name, N_DOF=self._n_dof)


def jump_scales(body: BodyModel, config: FilterConfig) -> np.ndarray:
    """(D,) factors of a change, such that the sum of their squares is its mean squared length in
    sigmas; 0 for degrees of freedom of no sigma, which do not move."""
    moves = body.sigma > 0
    sigma = config.smoothness_scale * np.where(moves, body.sigma, 1.0)
    return np.where(moves, 1 / sigma, 0.0) / np.sqrt(max(1, moves.sum()))

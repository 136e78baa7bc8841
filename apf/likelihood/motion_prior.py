"""Motion prior: squared distance of poses from the expected pose (kernels: motion_prior.cl)."""

from __future__ import annotations

import numpy as np

from apf.body.model import BodyModel
from apf.likelihood.term import Shared, Term
from apf.likelihood.terms.motion_prior import MotionPriorConfig
from cl import Array, Launch


class MotionPrior(Term):
    """Prior on the change from frame to frame: mean squared change in the body's sigmas.

    The change is measured from the expected pose: the last estimate plus `velocity` times the last
    change. `motion` (D, 2) float32 holds the last estimate and the expected pose; both are NaN
    before the first estimate, and the error is then 0. Twin: reference/likelihood/motion_prior.py.
    """

    kernels = "tracking/motion_prior"

    def __init__(self, shared: Shared, settings: MotionPriorConfig) -> None:
        body = shared.scene.body
        super().__init__(shared.scene.opencl, N_DOF=body.n_dof)
        self.settings, self._velocity, self._n_dof = settings, shared.velocity, body.n_dof
        factors = change_factors(body, settings).astype(np.float32)
        self._factors = self.device.to_device(factors, "the motion's factors")
        self.motion = self.device.empty((body.n_dof, 2), np.float32, "the expected pose")
        self.forget()

    def change_body(self, body: BodyModel) -> None:
        """Measure changes in the sigmas of `body` from now on."""
        self._factors.set(change_factors(body, self.settings).astype(np.float32))

    def forget(self, run: int | None = None) -> None:
        """Reset the expected pose before a new track."""
        self.motion.fill(np.nan)

    def launcher(self, poses: Array, weight: float, errors: Array) -> list[Launch]:
        """Return the launches that add to `errors` (n,) of `poses` (n, D) `weight` times the mean
        over their degrees of freedom of the squared change, in sigmas."""
        return [
            self.launch(
                "add_motion_errors",
                (poses.shape[0],),
                (64,),
                n=poses.shape[0],
                weight=weight,
                factors=self._factors,
                motion=self.motion,
                poses=poses,
                errors=errors,
            )
        ]

    def learning_launcher(self, pose: Array) -> list[Launch]:
        """Return the launches that update the expected pose; the frame's estimate is the first row
        of `pose` (.., D)."""
        return [
            self.launch(
                "expect_motion",
                (self._n_dof,),
                (64,),
                velocity=self._velocity,
                pose=pose,
                motion=self.motion,
            )
        ]


def change_factors(body: BodyModel, config: MotionPriorConfig) -> np.ndarray:
    """Return (D,) factors that scale a change so that its squared length is the mean squared change
    in sigmas; 0 for degrees of freedom with sigma 0, which do not move."""
    moves = body.sigma > 0
    sigma = config.scale * np.where(moves, body.sigma, 1.0)
    return np.where(moves, 1 / sigma, 0.0) / np.sqrt(max(1, moves.sum()))

"""The term near_limits: its launcher, and its twin."""

import numpy as np

from apf.body.model import BodyModel
from apf.likelihood.term import Shared, SharedTwin, Term, TermTwin
from cl import Array, Launch
from near_limits import NearLimitsConfig


def joint_ranges(body: BodyModel) -> np.ndarray:
    """Return (D, 2) middle of the limits and 1 / half of their distance; 0 and 0 where a degree of
    freedom has no limits or cannot move."""
    half = (body.upper - body.lower) / 2
    bound = np.isfinite(half) & (half > 0)
    middle = np.where(bound, body.lower + np.where(bound, half, 0), 0)
    return np.stack([middle, np.where(bound, 1 / np.where(bound, half, 1), 0)], -1)


class NearLimits(Term):
    """The term on a device."""

    kernels = "near_limits:near_limits"

    def __init__(self, shared: Shared, settings: NearLimitsConfig) -> None:
        body = shared.scene.body
        super().__init__(shared.scene.opencl, N_DOF=body.n_dof)
        self._free = settings.free
        ranges = joint_ranges(body).astype(np.float32)
        self._ranges = self.device.to_device(ranges, "the ranges of the joints")

    def change_body(self, body: BodyModel) -> None:
        self._ranges.set(joint_ranges(body).astype(np.float32))

    def launcher(self, poses: Array, weight: float, errors: Array) -> list[Launch]:
        n = poses.shape[0]
        return [
            self.launch(
                "add_limit_errors",
                (n,),
                (64,),
                n=n,
                weight=weight,
                free=self._free,
                ranges=self._ranges,
                poses=poses,
                errors=errors,
            )
        ]


class NumpyNearLimits(TermTwin):
    """The term in NumPy."""

    def __init__(self, shared: SharedTwin, settings: NearLimitsConfig) -> None:
        self._ranges, self._free = joint_ranges(shared.scene.body), settings.free

    def errors(self, poses: np.ndarray) -> np.ndarray:
        middle, factor = self._ranges.T
        beyond = np.maximum(np.abs(poses - middle) * factor - self._free, 0) / (1 - self._free)
        return np.mean(beyond**2, 1)

"""Gauss-Newton steps of the estimate against the surface voxels (kernel: refine.cl)."""

from __future__ import annotations

import numpy as np

from apf.body import BodyModel
from apf.config import FilterConfig
from apf.kinematics import pack_body
from apf.reference.kinematics import CONE_FLOATS
from apf.reference.refine import cone_moves, prior_deviation
from cl import Array, Device, Launch

_GROUP = 64


class Refinement:
    """Moves the estimate in `result` (its first D values) onto the surface voxels of `points`.

    `shift` is the device array (D,) that says by how much; zero where nothing is refined.
    """

    def __init__(self, device: Device, body: BodyModel, config: FilterConfig) -> None:
        self.device = device
        self.body = body
        self.config = config
        n = body.n_dof
        self.shift = device.zeros((n,), np.float32)
        self._body = [device.to_device(table, "the body model") for table in pack_body(body)]
        self._moves = device.to_device(cone_moves(body))
        self._sigma = device.to_device(prior_deviation(body, config).astype(np.float32))
        limits = np.stack([body.lower, body.upper], -1).astype(np.float32)
        self._limits = device.to_device(limits)
        self._scratch = [
            device.empty(shape, np.float32, "the refinement")
            for shape in ((n,), (len(body.cones), CONE_FLOATS), (n, 6), (config.n_points, n + 2))
        ]

    def launcher(self, points: Array, result: Array) -> list[Launch]:
        """The launch that refines, arguments set; none with `refine_steps` 0."""
        if self.config.refine_steps == 0:
            return []
        kernel = self.device.kernel(
            "refine",
            "refine",
            GROUP=_GROUP,
            N_STEPS=self.config.refine_steps,
            N_DOF=self.body.n_dof,
            N_BONES=len(self.body.bones),
            N_CONES=len(self.body.cones),
        )
        return [
            self.device.launch(
                kernel,
                (_GROUP,),
                (_GROUP,),
                np.int32(self.config.n_points),
                np.float32(self.config.refine_scale),
                np.float32(self.config.refine_reach),
                np.float32(self.config.refine_shrink),
                np.float32(self.config.refine_strength),
                points,
                *self._body,
                self._moves,
                self._sigma,
                self._limits,
                *self._scratch,
                result,
                self.shift,
            )
        ]

"""Gauss-Newton steps of the estimate against the surface voxels (kernel: refine.cl)."""

from __future__ import annotations

import numpy as np

from apf.body import BodyModel
from apf.config import FilterConfig
from apf.kinematics import body_defines, pack_body
from apf.reference.refine import cone_moves, prior_deviation
from cl import Array, Device, Launch, UserError
from psfs.launching import pack_defines

_GROUP = 256


class Refinement:
    """Moves `n_poses` poses (n_poses, D), each by itself, onto the surface voxels of `points`.

    `information` is the device array (n_poses, D (D + 1) / 2) of the lower triangle of the last
    linear system, row by row: how firmly voxels and prior hold the pose, about the inverse
    covariance; zero where nothing is refined.
    Raises UserError if the body has more degrees of freedom than local memory can hold.
    """

    def __init__(
        self, device: Device, body: BodyModel, config: FilterConfig, n_poses: int = 1
    ) -> None:
        self.device = device
        self.body = body
        self.config = config
        self.n_poses = n_poses
        n = body.n_dof
        block = 32 if device.is_gpu else 128
        self._defines = body_defines(body) | pack_defines(device, _GROUP) | {"BLOCK": block}
        pack = self._defines["PACK"]
        row = (n // pack + 1) * pack
        self._check_room(4 * row * max(n, block + 7))
        self._n_parts = -(-config.n_points // block)
        self.information = device.zeros((n_poses, n * (n + 1) // 2), np.float32)
        self._body = device.to_device(pack_body(body), "the body model")
        moves = np.zeros((len(body.cones), row), np.float32)
        moves[:, :n] = cone_moves(body) > 0
        self._moves = device.to_device(moves)
        self._sigma = device.to_device(prior_deviation(body, config).astype(np.float32))
        self._limits = device.to_device(body.limits)
        self._poses = device.empty((n_poses, n), np.float32)
        self._shift = device.empty((n_poses, n), np.float32)
        self._least = device.empty((n_poses,), np.float32)
        shape = (n_poses, self._n_parts, n * row + pack)
        self._parts = device.empty(shape, np.float32, "the refinement")

    def launcher(self, points: Array, results: Array) -> list[Launch]:
        """The launches that refine `results` (n_poses, D), arguments set; none with `refine_steps`
        0."""
        config, launches = self.config, []
        steps, reach = config.refine_steps, config.refine_reach
        for step in range(steps + 1 if steps else 0):
            poses = self._poses if step else results
            launches += [
                self._system(points, poses, reach),
                self._step(step == 0, step == steps, poses, results),
            ]
            reach = max(config.refine_scale, reach * config.refine_shrink)
        return launches

    def _system(self, points: Array, poses: Array, reach: float) -> Launch:
        group = self._defines["GROUP"]
        return self.device.launch(
            self.device.kernel("refine", "refine_system", **self._defines),
            (self._n_parts * group, self.n_poses),
            (group, 1),
            np.int32(self.config.n_points),
            np.float32(self.config.refine_scale),
            np.float32(reach),
            points,
            poses,
            self._body,
            self._moves,
            self._parts,
        )

    def _step(self, first: bool, last: bool, poses: Array, results: Array) -> Launch:
        config, group = self.config, self._defines["GROUP"]
        strength = config.refine_strength / config.n_points
        return self.device.launch(
            self.device.kernel("refine", "refine_step", **self._defines),
            (group * self.n_poses,),
            (group,),
            np.int32(first),
            np.int32(last),
            np.int32(self._n_parts),
            np.float32(strength),
            np.float32(strength / config.refine_scale**2),
            self._parts,
            self._sigma,
            self._limits,
            poses,
            self._poses,
            self._least,
            self._shift,
            self.information,
            results,
        )

    def _check_room(self, nbytes: int) -> None:
        room = self.device.handle.local_mem_size
        if nbytes > room:
            raise UserError(
                f"refining the {self.body.n_dof} degrees of freedom of the body {self.body.name} "
                f"needs {nbytes} bytes of local memory; {self.device.name} has {room}"
            )

"""Gauss-Newton steps of the estimate against surface voxels and observed points (kernels:
refinement.cl)."""

from __future__ import annotations

import numpy as np

from apf.body.jacobian import bone_moves, cone_moves
from apf.body.model import BodyModel
from apf.body.posing import CONE_DEFINES, FRAME_FLOATS, SPAN_FLOATS, body_defines, pack_body
from apf.filters.config import POINT_SCALE, VOXEL_SCALE, FilterConfig, GaussNewtonFit
from apf.likelihood.config import EXCHANGE_COST
from apf.likelihood.observations import ObservedPoints
from cl import Array, Device, InputError, Launch
from cl.signature import Argument
from cl.workgroups import GROUP, pack_defines
from psfs.cameras.camera import CAMERA_FLOATS
from psfs.common.cones import CONE_FLOATS

#: Weight of the voxels' mean cost against the prior's squared distance; that of each observed point
#: is 1, as for independent errors.
VOXEL_STRENGTH = 1350.0
#: Floats that the kernel keeps of a voxel.
_VOXEL_FLOATS = 9
#: Voxels that a work-group adds up: no more groups than an H200 has multiprocessors, few for a CPU.
_GPU_BLOCK, _CPU_BLOCK = 96, 256


class Refinement:
    """Gauss-Newton fit of `n_poses` independent poses to surface voxels and observed points.

    `information`: device array (n_poses, D (D + 1) / 2), the lower triangle of the last linear
    system, row by row: about the inverse covariance of the pose given voxels and prior; zero
    without refinement. `shift` (n_poses, D): how far each pose was moved. Raises InputError if the
    body has more degrees of freedom than fit into local memory.
    """

    def __init__(
        self,
        device: Device,
        body: BodyModel,
        config: FilterConfig,
        n_poses: int = 1,
        *,
        voxels: bool = True,
        observed: ObservedPoints | None = None,
        fit: GaussNewtonFit | None = None,
    ) -> None:
        self.device = device
        self.body = body
        self.fit, self._n_points = fit or config.fit, config.likelihood.n_points * voxels
        self._filter, self._observed = config, observed
        self.n_poses = n_poses
        n = body.n_dof
        block = _GPU_BLOCK if device.is_gpu else _CPU_BLOCK
        self._defines = body_defines(body) | pack_defines(device, GROUP) | {"BLOCK": block}
        self._defines |= {"VOXEL_FLOATS": _VOXEL_FLOATS, "CAMERA_FLOATS": CAMERA_FLOATS}
        pack = self._defines["PACK"]
        row = (n // pack + 1) * pack
        room = observed.room if observed is not None else 0
        self._n_parts = -(-self._n_points // block) + -(-room // (block // 2))
        self.information = device.zeros((n_poses, n * (n + 1) // 2), np.float32)
        self._body = device.to_device(pack_body(body), "the body model")
        self._check_room(row)
        moves = np.zeros((len(body.cones) + len(body.bones), row), np.float32)
        moves[:, :n] = np.concatenate([cone_moves(body), bone_moves(body)]) > 0
        self._moves = device.to_device(moves)
        self._sigma = device.to_device(prior_deviation(body, config, self.fit).astype(np.float32))
        self._limits = device.to_device(body.limits)
        self.shift = device.empty((n_poses, n), np.float32)
        self._least = device.empty((n_poses,), np.float32)
        shape = (n_poses, self._n_parts, n * row + pack)
        # What a step reads and what it writes.
        self._poses = [device.empty((n_poses, n), np.float32) for _ in range(2)]
        self._parts = [device.empty(shape, np.float32, "the refinement") for _ in range(2)]

    def change_body(self, body: BodyModel) -> None:
        """Refine poses of `body`, which differs from the one before in numbers alone."""
        self.body = body
        self._body.set(pack_body(body))
        self._sigma.set(prior_deviation(body, self._filter, self.fit).astype(np.float32))
        self._limits.set(body.limits)

    def launcher(self, points: Array | None, results: Array) -> list[Launch]:
        """Return the launches that fit `results` (n_poses, D) to the surface `points` (K, 4), if
        voxels are used, and to the observed points; no launches with 0 steps."""
        if self.fit.steps == 0:
            return []
        launches, poses = self._solve_launches(points, results)
        return [*launches, self._end(self.fit.steps, results, poses)]

    def shift_launcher(self, points: Array | None, results: Array) -> list[Launch]:
        """Return the launches that write to `shift` (n_poses, D) how far the fit would move
        `results`, which do not change; the cost after the last step is not evaluated."""
        return self._solve_launches(points, results)[0]

    def _solve_launches(self, points: Array | None, results: Array) -> tuple[list[Launch], Array]:
        """Return the launches of all steps, and the pose after the last one."""
        reaches, poses = self.fit.reaches, results
        launches = [self._system(points, poses, reaches[0], 0)]
        for step in range(self.fit.steps):
            launches += self._step(step, points, results, poses, reaches[step + 1])
            poses = self._poses[step % 2]
        return launches, poses

    def _step(
        self,
        step: int,
        points: Array | None,
        results: Array,
        poses: Array,
        reach: tuple[float, float],
    ) -> list[Launch]:
        """Return the launches that step from `poses` to the next ones and build the linear system
        there."""
        taken = self._step_arguments(results, poses, step) | {
            "first": step == 0,
            "limits": self._limits,
            "next": self._poses[step % 2],
        }
        if not self.device.is_gpu:
            size = (self._defines["GROUP"] * self.n_poses,)
            return [
                self._launch("refine_step", size, n_parts=self._n_parts, **taken),
                self._system(points, self._poses[step % 2], reach, step + 1),
            ]
        evidence = self._evidence(points, reach)
        next_parts = self._parts[(step + 1) % 2]
        return [self._launch("refine_on", self._size(), **evidence, **taken, next_parts=next_parts)]

    def _system(
        self, points: Array | None, poses: Array, reach: tuple[float, float], step: int
    ) -> Launch:
        evidence, parts = self._evidence(points, reach), self._parts[step % 2]
        return self._launch("refine_system", self._size(), **evidence, poses=poses, parts=parts)

    def _end(self, step: int, results: Array, poses: Array) -> Launch:
        return self._launch(
            "refine_end",
            (self._defines["GROUP"] * self.n_poses,),
            n_parts=self._n_parts,
            **self._step_arguments(results, poses, step),
            information=self.information,
        )

    def _evidence(self, points: Array | None, reach: tuple[float, float]) -> dict[str, Argument]:
        """Return the kernels' arguments for the linear system, by name."""
        observed = self._observed
        strength, weight = self._voxel_weights
        return {
            "n_points": self._n_points,
            "scale": VOXEL_SCALE,
            "reach": reach[0],
            "points": points,
            "point_scale": POINT_SCALE,
            "point_reach": reach[1],
            "point_root": (1 / weight) ** 0.5,
            "point_share": POINT_SCALE**2 / strength,
            "exchange": EXCHANGE_COST,
            "cameras": observed.cameras if observed is not None else None,
            "observed": observed.table if observed is not None else None,
            "table": self._body,
            "moves": self._moves,
        }

    @property
    def _voxel_weights(self) -> tuple[float, float]:
        """Strength of a voxel in the cost, and its weight in the linear system."""
        strength = VOXEL_STRENGTH / max(1, self._n_points)
        return strength, strength / VOXEL_SCALE**2

    def _step_arguments(self, results: Array, poses: Array, step: int) -> dict[str, Argument]:
        """Return the kernels' arguments for a step, by name."""
        strength, weight = self._voxel_weights
        return {
            "strength": strength,
            "weight": weight,
            "sigma": self._sigma,
            "means": results,
            "poses": poses,
            "parts": self._parts[step % 2],
            "least": self._least,
            "shifts": self.shift,
        }

    def _size(self) -> tuple[int, int]:
        """Return the global size: a work-group for every part of every pose's evidence."""
        return self._n_parts * self._defines["GROUP"], self.n_poses

    def _launch(self, name: str, size: tuple[int, ...], /, **arguments: Argument) -> Launch:
        kernel = self.device.kernel("tracking/refinement", name, **self._defines, **CONE_DEFINES)
        group = (self._defines["GROUP"], *[1] * (len(size) - 1))
        return self.device.launch(kernel, size, group, **arguments)

    def _check_room(self, row: int) -> None:
        """Raise InputError if local memory does not hold the kernels' arrays, `workspace` and
        system; row: floats per row of the linear system."""
        body, defines = self.body, self._defines
        packs = 8 * body.n_dof + FRAME_FLOATS * len(body.bones)
        packs += (CONE_FLOATS + SPAN_FLOATS) * len(body.cones)
        floats = defines["PACK"] * packs + row * (11 + defines["BLOCK"] + body.n_dof)
        floats += _VOXEL_FLOATS * defines["BLOCK"] + defines["GROUP"] + self._body.size + body.n_dof
        nbytes, room = 4 * floats, self.device.handle.local_mem_size
        if nbytes > room:
            raise InputError(
                f"refining the {self.body.n_dof} degrees of freedom of the body {self.body.name} "
                f"needs {nbytes} bytes of local memory; {self.device.name} has {room}"
            )


def prior_deviation(body: BodyModel, config: FilterConfig, fit: GaussNewtonFit) -> np.ndarray:
    """Return (D,) prior standard deviation of the refined pose about the particles' mean."""
    return np.maximum(fit.width * config.search.noise * body.sigma, 1e-6)

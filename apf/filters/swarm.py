"""Tracking by a particle swarm (Rymut 2016, 2.3; Kwolek & Rymut 2016, section 3)."""

from __future__ import annotations

import numpy as np

from apf.body.model import BodyModel
from apf.filters.base import DeviceTracker
from apf.filters.config import FilterConfig, SearchConfig
from apf.filters.particle_set import ParticleSet
from apf.filters.searches import SwarmConfig
from apf.likelihood.base import Likelihood
from apf.scene import Scene
from cl import Array, Device, Kernel, Launch, Step
from cl.workgroups import GROUP


class Swarm(ParticleSet):
    """Particle set with velocities and personal bests (kernels: swarm.cl).

    sets[0]: the particles' poses; sets[1]: the best pose that each has found in the frame. The
    global best is the parent of all particles of the next frame.
    """

    def __init__(
        self, device: Device, body: BodyModel, config: SearchConfig, swarm: SwarmConfig
    ) -> None:
        super().__init__(device, body, config)
        self.swarm = swarm
        self._velocities = device.empty(self.sets[0].shape, np.float32, "the velocities")
        self._best_errors = device.empty((config.n_particles,), np.float32, "the errors")

    def scatter(self) -> Launch:
        """Return the launch of eq. (2.31): the frame's particles, spread around the last best."""
        return self.diffuse(0, 1)

    def move(self, iteration: int) -> Launch:
        """Return the launch of eq. (2.27)-(2.28), for iterations from 1 on."""
        return self.device.launch(
            self._swarm_kernel("move"),
            (self.n_dof, self.config.n_particles),
            (32, 8),
            n=self.config.n_particles,
            iteration=iteration,
            inertia=self.swarm.inertia,
            cognitive=self.swarm.cognitive,
            social=self.swarm.social,
            seed=self._seed,
            frame=self.frame,
            limits=self._limits,
            result=self.result,
            bests=self.sets[1],
            velocities=self._velocities,
            poses=self.sets[0],
        )

    def update_bests(self, iteration: int, errors: Array) -> Launch:
        """Return the launch of eq. (2.29)-(2.30), from the `errors` (N,) of the poses."""
        return self.device.launch(
            self._swarm_kernel("update_bests"),
            (GROUP,),
            (GROUP,),
            n=self.config.n_particles,
            iteration=iteration,
            last=iteration == self.config.n_layers - 1,
            frame=self.frame,
            errors=errors,
            poses=self.sets[0],
            bests=self.sets[1],
            best_errors=self._best_errors,
            parents=self.parents,
            result=self.result,
        )

    def _swarm_kernel(self, name: str) -> Kernel:
        return self.device.kernel("tracking/swarm", name, GROUP=GROUP, N_DOF=self.n_dof)


class ParticleSwarm(DeviceTracker):
    """Tracker by a synchronous particle swarm with one global best.

    config: the swarm uses n_particles, n_layers as the number of iterations (each scores all
    particles once), noise, velocity, seed and the settings of the refinement. In an `Estimate`,
    pose is the global best, deviation that of the personal bests about it, ess the number of
    particles that improved in each iteration, and beta 0. Twin: reference/filters/swarm.py.
    """

    def __init__(
        self,
        scene: Scene,
        likelihood: Likelihood,
        config: FilterConfig,
        swarm: SwarmConfig | None = None,
    ) -> None:
        # Particles scatter once per frame, in all degrees of freedom.
        config = config.with_changes(trunk_layers=0)
        self._swarm = Swarm(scene.opencl, scene.body, config.search, swarm or SwarmConfig())
        super().__init__(scene, likelihood, self._swarm, config)

    def _search(self, source: int) -> list[Step]:
        swarm = self._swarm
        launches: list[Step] = []
        for iteration in range(self.config.search.n_layers):
            launches.append(swarm.move(iteration) if iteration else swarm.scatter())
            launches += self.likelihood.launcher(swarm.sets[0])
            launches.append(swarm.update_bests(iteration, self.likelihood.errors))
        return launches

"""Tracking by a particle filter with resampling, SIR (Rymut 2016, 2.3, algorithms 1 and 2)."""

from __future__ import annotations

import numpy as np

from apf.filters.base import DeviceTracker
from apf.filters.config import FilterConfig
from apf.filters.particle_set import ParticleSet
from apf.filters.searches import SirConfig
from apf.likelihood.base import Likelihood
from apf.scene import Scene
from cl import InputError, Step


class SirParticleFilter(DeviceTracker):
    """Particle filter that propagates by N(x, Sigma), weighs by exp(-(1 - f)^2 / sigma_z^2) and
    resamples.

    The likelihood's squared errors take the place of (1 - f)^2. The pose is the weighted mean.
    config: the filter uses n_particles, noise, velocity, seed, first_survival and the settings of
    the refinement. Raises InputError unless n_layers is 1. Twin: reference/filters/annealed.py.
    """

    def __init__(
        self,
        scene: Scene,
        likelihood: Likelihood,
        config: FilterConfig,
        sir: SirConfig | None = None,
    ) -> None:
        check_layers(config)
        self.sir = sir or SirConfig()
        device = scene.opencl
        self._squared = device.empty((config.search.n_particles,), np.float32, "the errors")
        particles = ParticleSet(device, scene.body, config.search)
        super().__init__(scene, likelihood, particles, config)

    def _search(self, source: int) -> list[Step]:
        particles, n = self.particles, self.config.search.n_particles
        squared = self.device.launch(
            self.device.kernel("tracking/sir", "squared_errors"),
            (n,),
            (64,),
            n=n,
            errors=self.likelihood.errors,
            squared=self._squared,
        )
        return [
            particles.diffuse(0, source),
            *self.likelihood.launcher(particles.sets[1 - source]),
            squared,
            particles.anneal(0, self._squared, self.sir.beta),
            particles.estimate(1 - source),
        ]


def check_layers(config: FilterConfig) -> None:
    """Raise InputError unless there is one layer."""
    if config.search.n_layers != 1:
        raise InputError(f"a particle filter with {config.search.n_layers} layers; expected 1")

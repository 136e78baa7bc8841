"""Tracking by a particle filter with resampling, SIR (Rymut 2016, 2.3, algorithms 1 and 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from apf.filters.base import DeviceTracker
from apf.filters.config import FilterConfig
from apf.filters.particle_set import ParticleSet
from apf.likelihood.base import Likelihood
from apf.scene import Scene
from cl import InputError, Step
from psfs.common.ranges import check_range


@dataclass(frozen=True)
class SirConfig:
    """The observation model of Rymut 2016 eq. (2.42)."""

    sigma_z: float = 0.0
    """Deviation of 1 - f; 0, the default, finds it anew in each frame, such that the effective
    sample size is `SearchConfig.first_survival` of the particles (Rymut does not state his)."""

    def __post_init__(self) -> None:
        check_range("sigma_z", self.sigma_z, 0, ends=True)

    @property
    def beta(self) -> float:
        """The exponent of exp(-(1 - f)^2), 0 for one to be found."""
        return self.sigma_z**-2 if self.sigma_z > 0 else 0.0


class SirParticleFilter(DeviceTracker):
    """Propagates by N(x, Sigma), weighs by exp(-(1 - f)^2 / sigma_z^2), resamples.

    One layer: the errors of the likelihood, squared, stand for (1 - f)^2. config: n_particles,
    noise, velocity, seed, first_survival, and what refines an estimate; n_layers must be 1. The
    pose is the weighted mean. Twin: reference/filters/sir.py. Raises InputError for another number
    of layers.
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
            None,
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

"""The SIR particle filter in NumPy. Twin of apf/filters/sir.py."""

from __future__ import annotations

import numpy as np

from apf.filters.base import Estimate
from apf.filters.config import FilterConfig
from apf.filters.searches import SirConfig
from apf.filters.sir import check_layers
from apf.reference.filters.annealing import (
    annealing_exponent,
    diffuse,
    effective_size,
    moments,
    normalised_weights,
    systematic_parents,
)
from apf.reference.filters.base import NumpyTracker
from apf.reference.filters.noise import uniform
from apf.reference.likelihood.base import NumpyLikelihood
from apf.scene import Scene


class NumpySirParticleFilter(NumpyTracker):
    """Rymut 2016 algorithms 1 and 2; same signature as SirParticleFilter."""

    def __init__(
        self,
        scene: Scene,
        likelihood: NumpyLikelihood,
        config: FilterConfig,
        sir: SirConfig | None = None,
    ) -> None:
        check_layers(config)
        super().__init__(scene, likelihood, config)
        self.sir = sir or SirConfig()

    def _search(self) -> Estimate:
        config, body = self.config.search, self.body
        poses = diffuse(self.poses, self._parents, self._noise(0), body.lower, body.upper)
        self.likelihood.turn = self._frame % 2
        squared = self.likelihood(poses) ** 2
        beta = self.sir.beta or annealing_exponent(squared, config.survival_rates[0])
        weights = normalised_weights(squared, beta)
        mean, deviation = moments(poses, weights)
        self.poses = poses
        self._parents = systematic_parents(weights, uniform(config.seed, self._frame, 0))
        size = effective_size(squared, beta)
        return Estimate(self.body, mean, deviation, *np.array([[size], [beta], [squared.min()]]))

"""The annealed particle filter in NumPy. Twin of apf/filters/annealed.py."""

from __future__ import annotations

from typing import Any

import numpy as np

from apf.filters.annealed import Estimate
from apf.filters.config import FilterConfig
from apf.reference.annealing import (
    annealing_exponent,
    diffuse,
    effective_size,
    moments,
    normalised_weights,
    systematic_parents,
)
from apf.reference.base import NumpyTracker, NumpyVoxelLikelihood
from apf.reference.noise import uniform
from apf.scene import Scene


class NumpyAnnealedParticleFilter(NumpyTracker):
    """Song et al. eq. (10)-(13), step by step; same signature as AnnealedParticleFilter."""

    def __init__(
        self,
        scene: Scene,
        config: FilterConfig | None = None,
        *,
        scorer: Any = None,
    ) -> None:
        config = config or FilterConfig()
        if scorer is None:
            scorer = NumpyVoxelLikelihood(scene, config)
        super().__init__(scene, scorer, config)

    def _search(self) -> Estimate:
        config, body = self.config, self.body
        history = []
        for layer in range(config.n_layers):
            self._poses = diffuse(
                self._poses, self._parents, self._noise(layer), body.lower, body.upper
            )
            # Launchers are made for two frames, which may end in different particle sets.
            self._take_turn(layer + self._frame % 2 * config.n_layers)
            errors = self.scorer(self._poses)
            beta = annealing_exponent(errors, config.survival_rates[layer])
            weights = normalised_weights(errors, beta)
            mean, self._deviation = moments(self._poses, weights)
            self._parents = systematic_parents(weights, uniform(config.seed, self._frame, layer))
            history.append((effective_size(errors, beta), beta, errors.min()))
        ess, beta, least_error = np.array(history).T
        return Estimate(mean, self._deviation, ess, beta, least_error)

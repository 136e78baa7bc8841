"""The SIR particle filter in NumPy, a layer of annealing over squared errors. Twin of
apf/filters/sir.py."""

from __future__ import annotations

import numpy as np

from apf.filters.config import FilterConfig
from apf.filters.searches import SirConfig
from apf.filters.sir import check_layers
from apf.reference.filters.annealed import NumpyAnnealedParticleFilter
from apf.reference.likelihood.base import NumpyLikelihood
from apf.scene import Scene


class NumpySirParticleFilter(NumpyAnnealedParticleFilter):
    """Rymut 2016 algorithms 1 and 2; same signature as SirParticleFilter."""

    def __init__(
        self,
        scene: Scene,
        likelihood: NumpyLikelihood,
        config: FilterConfig,
        sir: SirConfig | None = None,
    ) -> None:
        check_layers(config)
        super().__init__(scene, config, likelihood=likelihood)
        self.sir = sir or SirConfig()

    def _score(self, poses: np.ndarray) -> np.ndarray:
        return super()._score(poses) ** 2

    def _find_exponent(self, errors: np.ndarray, survival_rate: float) -> float:
        return self.sir.beta or super()._find_exponent(errors, survival_rate)

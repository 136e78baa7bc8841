"""Standard deviations of each layer's noise: the body's sigmas, the trunk first if wanted."""

from __future__ import annotations

import numpy as np

from apf.body.limbs import trunk_mask
from apf.body.model import BodyModel
from apf.filters.config import SearchConfig


def layer_sigmas(body: BodyModel, config: SearchConfig) -> np.ndarray:
    """Return (n_layers, D) deviation of each degree of freedom, before `SearchConfig.layer_noise`.

    With `trunk_layers`, so many first layers move the trunk alone, and the noise of all else
    begins to shrink afterwards (partitioned sampling, MacCormick & Isard 2000).
    """
    sigmas = np.tile(body.sigma, (config.n_layers, 1))
    first = min(config.trunk_layers, config.n_layers - 1)
    limbs = ~trunk_mask(body)
    sigmas[:first, limbs] = 0.0
    sigmas[first:, limbs] *= config.noise_decay**-first
    return sigmas

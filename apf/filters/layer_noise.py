"""Standard deviations of each layer's noise, with optional layers that move only the trunk."""

from __future__ import annotations

import numpy as np

from apf.body.limbs import trunk_mask
from apf.body.model import BodyModel
from apf.filters.config import SearchConfig


def layer_sigmas(body: BodyModel, config: SearchConfig) -> np.ndarray:
    """Return (n_layers, D) deviation of each degree of freedom, before `SearchConfig.layer_noise`.

    The first `SearchConfig.trunk_layers` layers move only the trunk; the noise of the limbs shrinks
    from the layer after them on (partitioned sampling, MacCormick & Isard 2000).
    """
    sigmas = np.tile(body.sigma, (config.n_layers, 1))
    first = min(config.trunk_layers, config.n_layers - 1)
    limbs = ~trunk_mask(body)
    sigmas[:first, limbs] = 0.0
    sigmas[first:, limbs] *= config.noise_decay**-first
    return sigmas

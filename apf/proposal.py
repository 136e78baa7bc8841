"""How far each layer's particles are spread: by the body's sigma, the trunk first if wanted."""

from __future__ import annotations

import numpy as np

from apf.body import BodyModel
from apf.config import FilterConfig


def layer_sigmas(body: BodyModel, config: FilterConfig) -> np.ndarray:
    """(n_layers, D) deviation of each degree of freedom, before `FilterConfig.layer_noise`.

    With `trunk_layers`, so many first layers move the trunk alone, and the noise of all else
    begins to shrink afterwards (partitioned sampling, MacCormick & Isard 2000).
    """
    sigmas = np.tile(body.sigma, (config.n_layers, 1))
    first = min(config.trunk_layers, config.n_layers - 1)
    limbs = ~trunk(body)
    sigmas[:first, limbs] = 0.0
    sigmas[first:, limbs] *= config.noise_decay**-first
    return sigmas


def trunk(body: BodyModel) -> np.ndarray:
    """(D,) bool: the degrees of freedom of bones beyond which the body branches."""
    n_children = np.zeros(len(body.bones), int)
    branches = np.zeros(len(body.bones), bool)
    for place in reversed(range(len(body.bones))):  # children come after their parents
        branches[place] |= n_children[place] > 1
        parent = body.bones[place].parent
        if parent >= 0:
            n_children[parent] += 1
            branches[parent] |= branches[place]
    found = np.zeros(body.n_dof, bool)
    for bone, branching in zip(body.bones, branches, strict=True):
        found[[axis.dof for axis in bone.axes]] = branching
    return found

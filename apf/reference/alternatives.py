"""The mean, or the mean with one limb elsewhere: the best, refined. Twin of alternatives.cl."""

from __future__ import annotations

from typing import Any

import numpy as np

from apf.anatomy import limbs_of
from apf.body import BodyModel
from apf.config import FilterConfig
from apf.reference.annealing import reflected
from apf.reference.noise import normals
from apf.reference.refine import refined


def proposals(
    body: BodyModel, mean: np.ndarray, config: FilterConfig, frame: int
) -> tuple[np.ndarray, np.ndarray]:
    """Poses (N, D): `mean`, then ones that differ from it in one limb by 1 (first) to `limb_spread`
    (last) sigma, and the limb (N,) of each, -1 of the mean."""
    limbs, n = limbs_of(body), config.n_particles
    which = np.r_[-1, np.arange(n - 1) % len(limbs)]
    scale = config.limb_spread ** (np.arange(-1, n - 1) / max(1, n - 2))
    noise = normals(config.seed, frame, config.n_layers, n, body.n_dof)
    moved = np.where(limbs[which], scale[:, None] * body.sigma * noise, 0.0)
    moved[0] = 0.0
    return reflected(mean + moved, body.lower, body.upper), which


def settled(
    body: BodyModel, scorer: Any, mean: np.ndarray, config: FilterConfig, frame: int
) -> tuple[np.ndarray, np.ndarray]:
    """The estimate (D,), and the matrix of its last linear system (see `refined`).

    scorer: `scorer.rescore(poses, stride)` gives errors (N,) by every `stride`-th of its `points`.
    """
    candidates = [mean]
    n_limbs = len(limbs_of(body)) if config.limb_spread > 0 and config.refine_steps > 0 else 0
    if n_limbs:
        poses, which = proposals(body, mean, config, frame)
        errors = scorer.rescore(poses, config.point_turns)
        for limb in range(n_limbs):
            tried = np.flatnonzero(which == limb)
            candidates.append(poses[tried[errors[tried].argmin()]] if len(tried) else mean)
    found = [refined(body, pose, scorer.points, config) for pose in candidates]
    best = 0
    if n_limbs:
        errors = scorer.rescore(np.stack([pose for pose, _ in found]), 1)
        rivals = np.r_[errors[0] * (1 - config.limb_margin), errors[1:]]
        best = int(rivals.argmin())
    return found[best]

"""Search for limbs that the mean places wrongly. Twin of limb_search.cl."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from apf.body.limbs import limb_masks
from apf.body.model import BodyModel
from apf.filters import limb_search
from apf.filters.config import FilterConfig
from apf.filters.limb_search import count_near, limb_ranges
from apf.reference.filters.annealing import reflect
from apf.reference.filters.noise import normals, uniforms
from apf.reference.filters.refinement import refine
from apf.reference.likelihood.base import NumpyLikelihood


def propose(
    body: BodyModel,
    mean: np.ndarray,
    config: FilterConfig,
    frame: int,
    seen: np.ndarray | None = None,
    *,
    round: int = 0,
    best: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Propose poses (N, D): the `mean`, then poses that differ from it in one limb. In the first
    half a limb deviates by 1 (first pose) to `reach` (last pose) sigma; in the second half it lies
    anywhere within its limits. seen: (D,) shift of the mean to the observed points; the first pose
    of each limb is shifted by it. In a later `round` the poses lie around those of the `best` (2 L,
    D) of the round before, and the first pose of each limb equals it. Also returns the limb (N,) of
    each pose: -1 for the mean, and limb + L in the second half, L the number of limbs."""
    limbs, n = limb_masks(body), config.search.n_particles
    near = count_near(n)
    which = np.r_[-1, np.arange(n - 1) % len(limbs)]
    far = np.arange(n) >= near
    kinds, layer = which + len(limbs) * far, config.search.n_layers + round
    reach = config.limb_search.reaches[round]
    noise = normals(config.search.seed, frame, layer, n, body.n_dof)
    if best is None:
        scale = reach ** (np.arange(-1, n - 1) / max(1, near - 2))
        share = uniforms(config.search.seed, frame, layer, n, body.n_dof)
        lower, upper = limb_ranges(body).T
        moved = np.where(far[:, None], lower + share * (upper - lower),
                         mean + scale[:, None] * body.sigma * noise)  # fmt: skip
        if seen is not None:
            moved[1 : min(near, 1 + len(limbs))] = mean + seen
    else:
        first = np.arange(n) - np.where(far, near, 1) < len(limbs)
        moved = best[kinds] + reach * body.sigma * np.where(first[:, None], 0.0, noise)
    poses = np.where(limbs[which], reflect(moved, body.lower, body.upper), mean)
    poses[0] = mean
    return poses, kinds


class LimbSearchResult(NamedTuple):
    """The estimate (D,), the matrix of its last linear system (see `refine`), the candidates
    (K, D) that it was chosen from, and their errors (K,)."""

    pose: np.ndarray
    information: np.ndarray
    candidates: np.ndarray
    errors: np.ndarray


def search_limbs(
    body: BodyModel, likelihood: NumpyLikelihood, mean: np.ndarray, config: FilterConfig, frame: int
) -> LimbSearchResult:
    """Search around the particles' `mean` (D,)."""
    candidates = [mean]
    n_limbs = len(limb_masks(body)) if config.searches_limbs else 0
    if n_limbs:
        seen = None
        if likelihood.observed is not None:
            met = refine(
                body,
                mean,
                None,
                config,
                likelihood.observed,
                judge_last=False,
                fit=config.point_fit,
            )
            seen = met[0] - mean
        stride = config.likelihood.point_turns
        tried: np.ndarray | None = None
        for round in range(len(config.limb_search.reaches)):
            poses, kinds = propose(body, mean, config, frame, seen, round=round, best=tried)
            errors = likelihood.rescore(poses, stride)
            of_kind = [np.flatnonzero(kinds == kind) for kind in range(2 * n_limbs)]
            tried = np.stack(
                [poses[rows[errors[rows].argmin()]] if len(rows) else mean for rows in of_kind]
            )
            candidates[1:] = tried
    evidence = (likelihood.points, config, likelihood.observed)
    refined = [refine(body, pose, *evidence) for pose in candidates]
    refined_poses = np.stack([pose for pose, _ in refined])
    best, errors = 0, np.zeros(1)
    if n_limbs:
        errors = likelihood.rescore(refined_poses, 1, config.limb_search.least_recall)
        gains = errors[0] - np.abs(errors[0]) * np.repeat(limb_search.MARGINS, n_limbs) - errors[1:]
        best = int(np.r_[0.0, gains].argmax())
    return LimbSearchResult(*refined[best], refined_poses, errors)

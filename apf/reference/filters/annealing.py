"""Exponent, weights, resampling and diffusion of a particle set. Twin of annealing.cl."""

from __future__ import annotations

import numpy as np

from apf.filters.particle_set import LOG2_BETA_LIMIT


def effective_size(errors: np.ndarray, beta: float) -> float:
    """Return (sum w)^2 / sum w^2 of w = exp(-beta (errors - min))."""
    weights = np.exp(-beta * (errors - errors.min()))
    return float(weights.sum() ** 2 / np.sum(weights**2))


def annealing_exponent(errors: np.ndarray, survival_rate: float) -> float:
    """Return beta at which the effective sample size is `survival_rate` of the set (Deutscher &
    Reid 2005), found by bisection of its logarithm."""
    low, high = -LOG2_BETA_LIMIT, LOG2_BETA_LIMIT
    while high - low > np.finfo(np.float32).eps:
        middle = 0.5 * (low + high)
        if effective_size(errors, 2.0**middle) > survival_rate * len(errors):
            low = middle
        else:
            high = middle
    return float(2.0 ** (0.5 * (low + high)))


def normalised_weights(errors: np.ndarray, beta: float) -> np.ndarray:
    """Return (N,) weights exp(-beta errors), summing to 1."""
    weights = np.exp(-beta * (errors - errors.min()))
    return weights / weights.sum()


def moments(poses: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean (D,), Song et al. eq. (12), and the standard deviation (D,) of poses (N, D)
    by `weights` (N,)."""
    mean = weights @ poses
    return mean, np.sqrt(weights @ (poses - mean) ** 2)


def systematic_parents(weights: np.ndarray, offset: float) -> np.ndarray:
    """Draw (N,) parents by systematic resampling at (i + offset) / N."""
    positions = (np.arange(len(weights)) + offset) / len(weights)
    parents = np.searchsorted(np.cumsum(weights), positions, side="right")
    return np.minimum(parents, len(weights) - 1)


def diffuse(
    poses: np.ndarray,
    parents: np.ndarray,
    noise: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> np.ndarray:
    """Return children (N, D): parents plus noise (N, D), reflected at the limits (Song et al. eq.
    11)."""
    return reflect(poses[parents] + noise, lower, upper)


def reflect(poses: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Reflect poses (N, D) at the limits, and cut them where that is not enough."""
    poses = np.where(poses < lower, 2 * lower - poses, poses)
    poses = np.where(poses > upper, 2 * upper - poses, poses)
    return np.clip(poses, lower, upper)

"""Colours of the parts of a body, and how badly poses go with them. Twin of part_colour.cl."""

from __future__ import annotations

import numpy as np

from apf.body.cones import distances
from apf.likelihood.config import LikelihoodConfig


def chromaticities(colours: np.ndarray, dark: float) -> np.ndarray:
    """Return (K, 3) chromaticity x, y and whether a camera sees it, of colours (K, 4).

    A colour is RGB 0..255 and the number of cameras. Its chromaticity is
    (R, G, B) / (R + G + B + dark) in the plane R + G + B = 0.
    """
    rgb = colours[:, :3].astype(float)
    red, green, blue = (rgb / (rgb.sum(1, keepdims=True) + dark)).T
    plane = [(red - green) / np.sqrt(2), (red + green - 2 * blue) / np.sqrt(6)]
    seen = colours[:, 3] > 0
    return np.stack([*plane, np.ones(len(rgb))], -1) * seen[:, None]


def colour_errors(
    points: np.ndarray, samples: np.ndarray, parts: np.ndarray, cones: np.ndarray, scale: float
) -> np.ndarray:
    """Return (N,) the mean over the samples (K, 3) that a camera sees of d^2 / (d^2 + scale^2).

    d is the distance from a sample's chromaticity to that of the part (C, 3) whose surface in cones
    (N, C, 16) is nearest to its point (K, 3). Parts that are not known cost nothing; 0 where no
    camera sees any sample. Geman & McClure 1987.
    """
    seen = samples[:, 2] > 0
    if not seen.any():
        return np.zeros(len(cones))
    d2 = np.sum((samples[seen, None, :2] - parts[:, :2]) ** 2, -1) / scale**2
    costs = np.where(parts[:, 2] > 0, d2 / (1 + d2), 0.0)
    nearest = [np.abs(distances(points[seen], posed)).argmin(1) for posed in cones]
    return np.array([costs[np.arange(len(costs)), part].mean() for part in nearest])


def learnt(
    parts: np.ndarray,
    points: np.ndarray,
    samples: np.ndarray,
    cones: np.ndarray,
    config: LikelihoodConfig,
) -> np.ndarray:
    """Return the parts' colours (C, 3) after a frame whose pose is cones (C, 16).

    Each moves by the share `rate` (all the way if it was not known) to the mean of the samples
    nearest to it, which count by scale^2 / (d^2 + scale^2), d the distance to its surface.
    """
    parts = parts.copy()
    if len(points) == 0:
        return parts
    away = np.abs(distances(points, cones))
    nearest = away.argmin(1)
    weights = samples[:, 2] / (1 + (away.min(1) / config.surface_scale) ** 2)
    for part in range(len(cones)):
        mine = weights * (nearest == part)
        if mine.sum() >= config.part_colour.least_samples:
            mean = mine @ samples[:, :2] / mine.sum()
            share = config.part_colour.rate if parts[part, 2] > 0 else 1.0
            parts[part, :2] += share * (mean - parts[part, :2])
            parts[part, 2] = 1.0
    return parts

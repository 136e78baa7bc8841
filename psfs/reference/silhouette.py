"""Silhouette likelihood maps, Song et al. eq. (1)-(2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from psfs.camera import CameraRig
from psfs.config import SilhouetteConfig

if TYPE_CHECKING:
    from psfs.background import Background


def silhouette_evidence(
    images: np.ndarray, rig: CameraRig, background: Background, config: SilhouetteConfig
) -> np.ndarray:
    """Evidence counts (V, H, W) int8 of pictures (V, H, W, 3) uint8; 0 outside the pictures."""
    ratio = np.stack(
        [
            background_ratio(image, mean, std, config)
            for image, mean, std in zip(images, background.mean, background.std, strict=True)
        ]
    )
    prior = config.foreground_prior
    likelihood = prior / (prior + (1 - prior) * np.exp(np.clip(ratio, -600, 600)))
    return np.where(in_pictures(rig), config.counts(likelihood), 0).astype(np.int8)


def mask_evidence(masks: np.ndarray, rig: CameraRig, config: SilhouetteConfig) -> np.ndarray:
    """Evidence counts (V, H, W) int8 of ready masks (V, H, W) uint8, 255 = person."""
    return np.where(in_pictures(rig), config.mask_counts(masks), 0).astype(np.int8)


def background_ratio(
    image: np.ndarray, mean: np.ndarray, std: np.ndarray, config: SilhouetteConfig
) -> np.ndarray:
    """(H, W) log of the background's density over the uniform foreground's, (1/256)^3.

    The background is N(I; alpha mu, sigma) with the light factor alpha that fits best within the
    shadow range, at the price of ((1 - alpha) / width)^2 / 2, or with alpha = 1 if that is better.
    """
    image, mean = image.astype(np.float64), mean.astype(np.float64)
    sigma = np.maximum(std, config.sigma_floor).astype(np.float64)
    weight = sigma**-2
    along = (weight * mean**2).sum(-1) + 1e-6
    alpha = (weight * image * mean).sum(-1) / along
    alpha = np.clip(alpha, config.shadow_low, config.shadow_high)
    shaded = (weight * (image - alpha[..., None] * mean) ** 2).sum(-1)
    shaded += ((1 - alpha) / config.shadow_width(mean)) ** 2
    plain = (weight * (image - mean) ** 2).sum(-1)
    peak = np.log(256 / (np.sqrt(2 * np.pi) * sigma)).sum(-1)
    ratio: np.ndarray = peak - 0.5 * np.minimum(plain, shaded)
    return ratio


def in_pictures(rig: CameraRig) -> np.ndarray:
    """(V, height, width) bool: pixels that exist in a view, which may be smaller than others."""
    inside = np.zeros((len(rig), rig.height, rig.width), bool)
    for view, camera in enumerate(rig):
        inside[view, : camera.size[1], : camera.size[0]] = True
    return inside

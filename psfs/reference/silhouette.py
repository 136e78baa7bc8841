"""Silhouette likelihood maps, Song et al. eq. (1)-(2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from psfs.camera import CameraRig
from psfs.config import SilhouetteConfig
from psfs.foreground import BINS, CELL

if TYPE_CHECKING:
    from psfs.background import Background
    from psfs.reference.foreground import NumpyForeground


def silhouette_evidence(
    images: np.ndarray,
    rig: CameraRig,
    background: Background,
    config: SilhouetteConfig,
    foreground: NumpyForeground | None = None,
) -> np.ndarray:
    """Evidence counts (V, H, W) int8 of pictures (V, H, W, 3) uint8; 0 outside the pictures.

    The log ratios of background over foreground, limited and rounded to counts, are summed over
    3x3 pixels, where those outside the pictures say nothing. `foreground` None: it is uniform.
    """
    ratios = []
    for view, (image, mean, std) in enumerate(
        zip(images, background.mean, background.std, strict=True)
    ):
        if foreground is None:
            ratios.append(config.ratio_steps * background_ratio(image, mean, std, config))
            continue
        zone = foreground.zone[view].repeat(CELL, 0).repeat(CELL, 1)
        zone = zone[: image.shape[0], : image.shape[1]]
        blue, green, red = np.moveaxis(image.astype(int) * BINS // 256, -1, 0)
        colours = foreground.colours[(blue * BINS + green) * BINS + red].astype(int)
        ratios.append(
            config.ratio_steps * background_ratio(image, mean, std, config, zone) - colours
        )
    lowest, highest = config.ratio_range
    counts = np.floor(np.clip(np.stack(ratios), lowest, highest) + 0.5).astype(int)
    inside = in_pictures(rig)
    sums = box_sums(np.where(inside, counts, 0))
    return np.where(inside, config.ratio_counts()[sums - 9 * lowest], 0).astype(np.int8)


def box_sums(counts: np.ndarray) -> np.ndarray:
    """Sums over 3x3 pixels of each view (V, H, W); beyond the border there are zeros."""
    padded = np.pad(counts, ((0, 0), (1, 1), (1, 1)))
    rows = padded[:, :-2] + padded[:, 1:-1] + padded[:, 2:]
    sums: np.ndarray = rows[..., :-2] + rows[..., 1:-1] + rows[..., 2:]
    return sums


def mask_evidence(masks: np.ndarray, rig: CameraRig, config: SilhouetteConfig) -> np.ndarray:
    """Evidence counts (V, H, W) int8 of ready masks (V, H, W) uint8, 255 = person."""
    return np.where(in_pictures(rig), config.mask_counts(masks), 0).astype(np.int8)


def background_ratio(
    image: np.ndarray,
    mean: np.ndarray,
    std: np.ndarray,
    config: SilhouetteConfig,
    zone: np.ndarray | None = None,
) -> np.ndarray:
    """(H, W) log of the background's density over the uniform foreground's, (1/256)^3.

    The background is N(I; alpha mu, sigma) with the light factor alpha that fits best within the
    shadow range, at the price of ((1 - alpha) / width)^2 / 2, or with alpha = 1 if that is better.
    In the `zone` (H, W) bool of the person's shadow the range is wider and the price at most
    floor_shadow_cost + (1 - alpha)^2 / 2.
    """
    image, mean = image.astype(np.float64), mean.astype(np.float64)
    zone = np.zeros(image.shape[:2], bool) if zone is None else zone
    sigma = np.maximum(std, config.sigma_floor).astype(np.float64)
    weight = sigma**-2
    along = (weight * mean**2).sum(-1) + 1e-6
    lowest = np.where(zone, config.floor_shadow_low, config.shadow_low)
    alpha = np.clip((weight * image * mean).sum(-1) / along, lowest, config.shadow_high)
    price = ((1 - alpha) / config.shadow_width(mean)) ** 2
    on_floor = np.minimum(price, 2 * config.floor_shadow_cost + (1 - alpha) ** 2)
    shaded = (weight * (image - alpha[..., None] * mean) ** 2).sum(-1)
    shaded += np.where(zone, on_floor, price)
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

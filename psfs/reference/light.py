"""Estimation of every picture's light relative to the background's."""

from __future__ import annotations

import numpy as np

from psfs.background.config import BackgroundConfig, LightConfig
from psfs.background.gaussian import Background
from psfs.background.light import (
    LIGHT_FLOATS,
    fit_light,
    light_samples,
    sampled_scene,
    steady_light,
)
from psfs.cameras.camera import CameraRig


def estimate_light(
    images: np.ndarray,
    rig: CameraRig,
    background: Background,
    config: LightConfig,
    density: BackgroundConfig,
) -> np.ndarray:
    """Return the light (V, LIGHT_FLOATS) float64 of pictures (V, H, W, 3), in the layout of
    `psfs.background.light.LIGHT_FLOATS`; twin of light.cl."""
    if not config.follow:
        return steady_light(len(rig)).astype(np.float64)
    pixels, (_, scene) = light_samples(rig), sampled_scene(rig, background, density)
    light = np.empty((len(rig), LIGHT_FLOATS))
    for view, camera in enumerate(rig):
        x, y = pixels[view].T
        shown, sampled = images[view, y, x].astype(np.float64), scene[view].astype(np.float64)
        light[view] = fit_light(shown[None], sampled, camera.size)[0]
    return light


def apply_light(background: Background, light: np.ndarray, density: BackgroundConfig) -> Background:
    """Return the background, in float64, relit by `light` (V, LIGHT_FLOATS)."""
    mean, std = np.empty((2, *background.mean.shape))
    for view, (own, field) in enumerate(zip(light, _fields(light, mean.shape), strict=True)):
        bright = own[:3] * (background.mean[view] * field) + own[3:6]
        mean[view] = np.minimum(bright, 255)
        std[view] = np.maximum(background.std[view], density.sigma_floor) * own[9] ** -0.5
    return Background(mean, std)


def _fields(light: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return (V, H, W, 1) the gain that varies over the picture."""
    y, x = np.indices(shape[1:3])
    fields: np.ndarray = np.einsum("vk,khw->vhw", light[:, 6:9], np.stack([np.ones(x.shape), x, y]))
    return fields[..., None]

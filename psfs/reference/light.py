"""The light of every picture beside that of the background."""

from __future__ import annotations

import numpy as np

from psfs.background.config import BackgroundConfig, LightConfig
from psfs.background.gaussian import Background
from psfs.background.light import (
    EXPECTED_SPREAD2,
    GAINS,
    LIGHT_FLOATS,
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
    """Return the light (V, LIGHT_FLOATS) float64 of pictures (V, H, W, 3), laid out as
    `psfs.background.light.LIGHT_FLOATS` says; twin of light.cl."""
    if not config.follow:
        return steady_light(len(rig)).astype(np.float64)
    pixels, (_, scene) = light_samples(rig), sampled_scene(rig, background, density)
    light = np.empty((len(rig), LIGHT_FLOATS))
    for view, camera in enumerate(rig):
        x, y = pixels[view].T
        shown, sampled = images[view, y, x].astype(np.float64), scene[view].astype(np.float64)
        gain, offset, slope, spread = _fit(shown, sampled, config)
        width, height = camera.size
        field = 2 * slope / camera.size
        first = 1 + slope @ ((1 / np.array([width, height])) - 1)
        light[view] = *gain, *offset, first, *field, spread**-2, 3 * np.log(spread), 0
    return light


def _fit(
    shown: np.ndarray, scene: np.ndarray, config: LightConfig
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return gain (3,), offset (3,), slope of the field (2,) and spread of samples that are `shown`
    (n, 3) before a `scene` (8, n): iteratively reweighted least squares (Geman and McClure).

    A sample weighs 1 / (1 + d^2 / (3 scale^2))^2 by its squared distance d^2 in standard
    deviations of the background, with a scale that shrinks. In each step gains and offsets are
    fitted to the field as it was, and the field to them as they were.
    """
    mean, weight, place = scene[:3].T, scene[3:6].T, scene[6:].T
    gain, offset, slope, spread = np.ones(3), np.zeros(3), np.zeros(2), 1.0
    for step, scale in enumerate(config.scales()):
        lit = mean * (1 + place @ slope)[:, None]
        rest = shown - (gain * lit + offset)
        distance = (weight * rest**2).sum(1)
        trust = (1 + distance / (3 * scale**2)) ** -2
        spread = float((trust * distance).sum() / (3 * EXPECTED_SPREAD2 * trust.sum() + 1e-6))
        weights = config.independent * trust[:, None] * weight
        change = _slope_change(weights, gain * mean, rest, place, slope, config)
        aa = (weights * lit * lit).sum(0) + config.gain_width**-2
        bb = weights.sum(0) + config.offset_width**-2
        ab, b = (weights * lit).sum(0), (weights * shown).sum(0)
        a = (weights * lit * shown).sum(0) + config.gain_width**-2
        determinant = aa * bb - ab * ab
        gain = np.clip((a * bb - b * ab) / determinant, *GAINS)
        offset = (aa * b - ab * a) / determinant
        slope = slope + change * (step > 0)  # before, the gains are far off
    return gain, offset, slope, float(np.sqrt(max(spread, 1.0)))


def _slope_change(
    weights: np.ndarray,
    lit: np.ndarray,
    rest: np.ndarray,
    place: np.ndarray,
    slope: np.ndarray,
    config: LightConfig,
) -> np.ndarray:
    """Return by how much the field's slope (2,) changes."""
    square, product = (weights * lit * lit).sum(1), (weights * lit * rest).sum(1)
    matrix = np.einsum("n,ni,nj->ij", square, place, place) + np.eye(2) * config.field_width**-2
    return np.linalg.solve(matrix, product @ place - slope * config.field_width**-2)


def lit_by(background: Background, light: np.ndarray, density: BackgroundConfig) -> Background:
    """Return the background, in float64, as pictures in such `light` (V, LIGHT_FLOATS) show it."""
    mean, std = np.empty((2, *background.mean.shape))
    for view, (own, field) in enumerate(zip(light, _fields(light, mean.shape), strict=True)):
        bright = own[:3] * (background.mean[view] * field) + own[3:6]
        mean[view] = np.minimum(bright, 255)
        std[view] = np.maximum(background.std[view], density.sigma_floor) * own[9] ** -0.5
    return Background(mean, std)


def unlit(images: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Return pictures (V, H, W, 3), in float64, as they are in the background's own light."""
    gains, offsets = light[:, None, None, :3], light[:, None, None, 3:6]
    own: np.ndarray = (images - offsets) / (gains * _fields(light, images.shape))
    return own


def _fields(light: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return (V, H, W, 1) the gain that differs over a picture."""
    y, x = np.indices(shape[1:3])
    fields: np.ndarray = np.einsum("vk,khw->vhw", light[:, 6:9], np.stack([np.ones(x.shape), x, y]))
    return fields[..., None]

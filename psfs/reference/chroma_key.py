"""The NumPy twin of chroma_key.cl: a screen of one colour as background."""

from __future__ import annotations

import numpy as np

from psfs.background.chroma_key import (
    AREA,
    BRIGHT,
    DARK,
    LEAST_SPREAD,
    LIGHT_STD,
    NOISE,
    ChromaKey,
)
from psfs.common.colours import chromaticity


def chroma_ratio(image: np.ndarray, background: ChromaKey, view: int) -> np.ndarray:
    """Return (H, W) log of the screen's density over the foreground's, of chromaticities.

    The screen's chromaticity has a normal distribution, which is wider for dark pixels, since noise
    affects these more. More saturated pixels count as screen, too, since shaded folds are more
    saturated; less saturated ones are the person, since clothes tinted by the screen's light keep
    most of their colour. Brightness beyond the screen's range lowers its density. The foreground is
    uniform. See `ChromaKey`.
    """
    key, spread = background.key[view], np.maximum(background.spread[view], LEAST_SPREAD)
    saturation = np.linalg.norm(key)
    direction = key / saturation
    shown = chromaticity(image)
    along = np.minimum(shown @ direction - saturation, 0)
    across = shown @ np.array([-direction[1], direction[0]])
    total = image.astype(np.float64).sum(-1) + 1
    variance = spread**2 + (NOISE / total[..., None]) ** 2
    light = total / background.light[view]
    off = np.maximum(DARK - light, 0) + np.maximum(light - BRIGHT, 0)
    least = along**2 / variance[..., 0] + across**2 / variance[..., 1] + (off / LIGHT_STD) ** 2
    peak = np.log(AREA / (2 * np.pi)) - 0.5 * np.log(variance).sum(-1)
    return peak - 0.5 * least

"""Chromaticity, bins, and parsing of colours; the colour of clay."""

from __future__ import annotations

import re

import numpy as np

from cl import InputError

#: Colour of surfaces without colours, RGB 0..1.
CLAY = (0.80, 0.70, 0.59)
#: Number of colour bins: 16 per channel.
N_BINS = 16**3


def chromaticity(pixels: np.ndarray) -> np.ndarray:
    """Return the chromaticity (..., 2) of colours (..., 3) BGR.

    (r - g) / sqrt 2 and (r + g - 2 b) / sqrt 6, where r, g, b are shares of the brightness. 0 is
    grey, the direction is the hue and the length the saturation; light and shadow do not change it.
    """
    b, g, r = np.moveaxis(pixels.astype(np.float64), -1, 0)
    total = b + g + r + 1
    return np.stack([(r - g) / np.sqrt(2), (r + g - 2 * b) / np.sqrt(6)], -1) / total[..., None]


def parse_colour(text: object) -> np.ndarray:
    """Parse `#rrggbb` to a colour (3,) float BGR. Raises InputError for anything else."""
    if not isinstance(text, str) or not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        raise InputError(f"key = {text!r}; expected a colour #rrggbb, such as #00b140")
    return np.array([int(text[i : i + 2], 16) for i in (5, 3, 1)], np.float64)


def colour_bins(colours: np.ndarray, levels: int = 16) -> np.ndarray:
    """Return the number of the bin (...) of colours (..., 3) uint8 or float, with `levels` bins per
    channel, a power of 2."""
    steps = colours // (256 // levels)
    bins = steps[..., 0].astype(np.intp)
    for channel in (1, 2):
        bins *= levels
        bins += steps[..., channel].astype(np.intp)
    return bins

"""The colours of voxels and meshes, by what they are to show."""

from __future__ import annotations

import cv2
import numpy as np
import scipy

from psfs.common.colours import CLAY
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelCloud

#: Colours of confidence, 0 to 1, everywhere: red, yellow, green, as CSS has them. Red is darker
#: than yellow for people who are colour-blind.
CONFIDENCE = ((0.0, "#8e1b1b"), (0.35, "#e08a3c"), (0.5, "#f1dc8a"), (1.0, "#2e8b57"))
#: What a voxel's colour can show.
COLOURINGS = ("colour", "probability", "height")


def colour_voxels(cloud: VoxelCloud, colouring: str = COLOURINGS[0]) -> np.ndarray:
    """Return (N, 3) uint8 RGB of the voxels.

    colouring: one of COLOURINGS. "colour": the pictures' colours, or clay if the cloud has none;
    "probability": CONFIDENCE from the threshold to 1; "height": turbo over the grid's height.
    """
    if colouring == "probability":
        least = OccupancyConfig().threshold
        return _colour_confidence((cloud.probability - least) / (1 - least))
    if colouring == "height":
        low, high = cloud.grid.low[2], cloud.grid.high[2]
        return _colour_height((cloud.centres[:, 2] - low) / (high - low))
    if cloud.colour is None:
        return np.tile(np.rint(255 * np.array(CLAY)).astype(np.uint8), (len(cloud), 1))
    return cloud.colour


def colour_vertices(vertices: np.ndarray, cloud: VoxelCloud, colouring: str) -> np.ndarray:
    """Return (N, 3) uint8 RGB of a mesh's vertices (N, 3) m: those of the nearest voxels."""
    _, nearest = scipy.spatial.cKDTree(cloud.centres).query(vertices)
    return colour_voxels(cloud, colouring)[nearest]


def describe_scale(colouring: str, low: float, high: float) -> tuple[str, list[str]]:
    """Return what the ends of a colouring's scale mean, and its colours from one to the other as
    CSS has them; none if they are the pictures' own. low, high: of the grid, m."""
    if colouring == "probability":
        text, colour = f"{OccupancyConfig().threshold:g} to 1", _colour_confidence
    elif colouring == "height":
        text, colour = f"{low:.3g} to {high:.3g} m", _colour_height
    else:
        return "", []
    steps = colour(np.linspace(0, 1, 9))
    return text, [f"rgb({r},{g},{b})" for r, g, b in steps.tolist()]


def _colour_confidence(values: np.ndarray) -> np.ndarray:
    """Map values 0..1 to (N, 3) uint8 RGB along CONFIDENCE."""
    ends = np.array([[int(css[k : k + 2], 16) for k in (1, 3, 5)] for _, css in CONFIDENCE])
    steps = [step for step, _ in CONFIDENCE]
    channels = [np.interp(values, steps, channel) for channel in ends.T]
    return np.rint(np.stack(channels, -1)).astype(np.uint8)


def _colour_height(values: np.ndarray) -> np.ndarray:
    """Map values 0..1 to (N, 3) uint8 RGB along turbo."""
    levels = np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)
    if not len(levels):
        return np.zeros((0, 3), np.uint8)
    return cv2.applyColorMap(levels[:, None], cv2.COLORMAP_TURBO)[:, 0, ::-1]

"""The colours of voxels and meshes, by what they are to show."""

from __future__ import annotations

import cv2
import numpy as np
from scipy import spatial

from psfs.mesh.marching_cubes import CLAY
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelCloud

#: What a voxel's colour can show.
COLOURINGS = ("colour", "probability", "height")


def colour_voxels(cloud: VoxelCloud, colouring: str = COLOURINGS[0]) -> np.ndarray:
    """Return (N, 3) uint8 RGB of the voxels.

    colouring: one of COLOURINGS. "colour": the pictures' colours, or clay if the cloud has none;
    "probability": viridis from the threshold to 1; "height": turbo over the grid's height.
    """
    if colouring == "probability":
        least = OccupancyConfig().threshold
        return _apply_colour_map((cloud.probability - least) / (1 - least), cv2.COLORMAP_VIRIDIS)
    if colouring == "height":
        low, high = cloud.grid.low[2], cloud.grid.high[2]
        return _apply_colour_map((cloud.centres[:, 2] - low) / (high - low), cv2.COLORMAP_TURBO)
    if cloud.colour is None:
        return np.tile(np.rint(255 * np.array(CLAY)).astype(np.uint8), (len(cloud), 1))
    return cloud.colour


def colour_vertices(vertices: np.ndarray, cloud: VoxelCloud, colouring: str) -> np.ndarray:
    """Return (N, 3) uint8 RGB of a mesh's vertices (N, 3) m: those of the nearest voxels."""
    _, nearest = spatial.cKDTree(cloud.centres).query(vertices)
    return colour_voxels(cloud, colouring)[nearest]


def describe_scale(colouring: str, low: float, high: float) -> tuple[str, list[str]]:
    """Return what the ends of a colouring's scale mean, and its colours from one to the other as
    CSS has them; none if they are the pictures' own. low, high: of the grid, m."""
    if colouring == "probability":
        text, colours = f"{OccupancyConfig().threshold:g} to 1", cv2.COLORMAP_VIRIDIS
    elif colouring == "height":
        text, colours = f"{low:.3g} to {high:.3g} m", cv2.COLORMAP_TURBO
    else:
        return "", []
    steps = _apply_colour_map(np.linspace(0, 1, 9), colours)
    return text, [f"rgb({r},{g},{b})" for r, g, b in steps.tolist()]


def _apply_colour_map(values: np.ndarray, colours: int) -> np.ndarray:
    """Map values 0..1 to (N, 3) uint8 RGB by one of OpenCV's colour maps."""
    levels = np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)
    if not len(levels):
        return np.zeros((0, 3), np.uint8)
    return cv2.applyColorMap(levels[:, None], colours)[:, 0, ::-1]

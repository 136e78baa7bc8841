"""Cells of pixels: the floor's light and the location prior have one value per cell."""

from __future__ import annotations

import numpy as np

from psfs.cameras.camera import CameraRig

#: Edge of a cell, px. The kernels' layout of packs and blocks depends on it.
CELL = 4


def cells(rig: CameraRig) -> tuple[int, int]:
    """Return the rows and columns of cells that cover the largest picture."""
    return -(-rig.height // CELL), -(-rig.width // CELL)


def cell_rays(rig: CameraRig) -> np.ndarray:
    """Return the world directions (V, rows, columns, 3), of depth 1, of the rays through the
    middles of the cells; NaN where a lens shows nothing."""
    rows, columns = cells(rig)
    u, v = np.meshgrid(np.arange(columns), np.arange(rows))
    pixels = (CELL * np.stack([u, v], -1) + (CELL - 1) / 2).reshape(-1, 2)
    return np.stack([camera.rays(pixels).reshape(rows, columns, 3) for camera in rig])

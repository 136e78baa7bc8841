"""Cells of pixels: the floor's light and the location prior have one value per cell."""

from __future__ import annotations

from psfs.cameras.camera import CameraRig

#: Edge of a cell, px. The kernels' layout of packs and blocks depends on it.
CELL = 4


def cells(rig: CameraRig) -> tuple[int, int]:
    """Return the rows and columns of cells that cover the largest picture."""
    return -(-rig.height // CELL), -(-rig.width // CELL)

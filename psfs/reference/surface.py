"""Smoothing, threshold and surface voxels (Song et al. 2.2.2, last step)."""

from __future__ import annotations

import numpy as np


def smooth(padded: np.ndarray) -> np.ndarray:
    """Mean over 3x3x3 voxels: (nx + 2, ny + 2, nz + 2) -> (nx, ny, nz)."""
    nx, ny, nz = (n - 2 for n in padded.shape)
    total = np.zeros((nx, ny, nz))
    for dx, dy, dz in np.ndindex(3, 3, 3):
        total += padded[dx : dx + nx, dy : dy + ny, dz : dz + nz]
    return total / 27


def surface_voxels(occupied: np.ndarray) -> np.ndarray:
    """(N,) int32 ascending flat indices of the occupied voxels with an empty 6-neighbour.

    What lies outside the grid counts as empty.
    """
    padded = np.pad(occupied, 1)
    inside = occupied.copy()
    for axis in range(3):
        for shift in (-1, 1):
            inside &= np.roll(padded, shift, axis)[1:-1, 1:-1, 1:-1]
    return np.flatnonzero(occupied & ~inside).astype(np.int32)

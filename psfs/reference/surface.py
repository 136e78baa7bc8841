"""Smoothing, threshold and surface voxels (Song et al. 2.2.2, last step)."""

from __future__ import annotations

import numpy as np


def smooth(padded: np.ndarray, faces: bool = False) -> np.ndarray:
    """Return the mean over 3x3x3 voxels, or over each and its six neighbours if `faces`: (nx + 2,
    ny + 2, nz + 2) -> (nx, ny, nz)."""
    nx, ny, nz = (n - 2 for n in padded.shape)
    total = np.zeros((nx, ny, nz))
    for dx, dy, dz in np.ndindex(3, 3, 3):
        if not faces or abs(dx - 1) + abs(dy - 1) + abs(dz - 1) <= 1:
            total += padded[dx : dx + nx, dy : dy + ny, dz : dz + nz]
    return total / (7 if faces else 27)


def surface_voxels(occupied: np.ndarray, closed: bool = False) -> np.ndarray:
    """Return the flat indices (N,) int32, ascending, of occupied voxels with an empty neighbour,
    one of 26 if `closed`, else of 6.

    Voxels outside the grid count as empty.
    """
    padded = np.pad(occupied, 1)
    inside = occupied.copy()
    for shift in np.ndindex(3, 3, 3):
        offset = np.array(shift) - 1
        if closed or np.abs(offset).sum() == 1:
            inside &= np.roll(padded, tuple(offset), (0, 1, 2))[1:-1, 1:-1, 1:-1]
    return np.flatnonzero(occupied & ~inside).astype(np.int32)


def mean_position(
    surface: np.ndarray, shape: tuple[int, int, int], samples: int
) -> np.ndarray | None:
    """Return the mean position (3,) of the surface voxels, flat indices (N,), in voxels from the
    grid's corner; None if there are none. If there are more than `samples`, that many are taken
    evenly from the list.
    """
    if not len(surface):
        return None
    n = min(len(surface), samples)
    picked = surface[np.arange(n) * len(surface) // n]
    return (np.stack(np.unravel_index(picked, shape), -1) + 0.5).mean(0)

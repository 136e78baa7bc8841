"""Voxel occupancy, Song et al. eq. (3)-(9)."""

from __future__ import annotations

import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.silhouettes.hidden import UNKNOWN
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelGrid


def padded_grid(grid: VoxelGrid) -> VoxelGrid:
    """Return `grid` with one more layer of voxels on every side."""
    shape = (grid.shape[0] + 2, grid.shape[1] + 2, grid.shape[2] + 2)
    return VoxelGrid(grid.origin - grid.voxel_size, grid.voxel_size, shape)


def occupancy(
    rig: CameraRig, grid: VoxelGrid, evidence: np.ndarray, step: float, config: OccupancyConfig
) -> np.ndarray:
    """Return P(V = 1) of the padded grid (nx + 2, ny + 2, nz + 2) by evidence counts (V, H, W).

    A camera in which something stands before a voxel (`UNKNOWN`) does not see it.
    """
    padded = padded_grid(grid)
    centres = padded.centres()
    log_odds = np.full(len(centres), np.log(config.prior / (1 - config.prior)))
    seeing = np.zeros(len(centres), int)
    for camera, counts in zip(rig, evidence, strict=True):
        inside, row, column, _ = camera.look_up(centres)
        seen = counts[row, column]
        known = seen != UNKNOWN
        log_odds[inside] += np.where(known, seen, 0) * step
        seeing[inside] += known
    probability = np.where(
        seeing >= config.seeing_cameras(len(rig)), 1 / (1 + np.exp(-log_odds)), 0.0
    )
    return probability.reshape(padded.shape)

"""Voxel occupancy, Song et al. eq. (3)-(9)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.silhouettes.hidden import UNKNOWN
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelGrid

#: Counts (N,) that a tracked body adds to voxels at points (N, 3) m.
BodyEvidence = Callable[[np.ndarray], np.ndarray]


def padded_grid(grid: VoxelGrid) -> VoxelGrid:
    """Return `grid` with one more layer of voxels on every side."""
    shape = (grid.shape[0] + 2, grid.shape[1] + 2, grid.shape[2] + 2)
    return VoxelGrid(grid.origin - grid.voxel_size, grid.voxel_size, shape)


def occupancy(
    rig: CameraRig,
    grid: VoxelGrid,
    evidence: np.ndarray,
    step: float,
    config: OccupancyConfig,
    *,
    body: BodyEvidence | None = None,
) -> np.ndarray:
    """Return P(V = 1) of the padded grid (nx + 2, ny + 2, nz + 2) by evidence counts (V, H, W).

    A camera in which something stands before a voxel (`UNKNOWN`) does not see it. body: the counts
    (N,) that a tracked body adds to voxels at points (N, 3); the sum is limited as the table is.
    """
    padded = padded_grid(grid)
    centres = padded.centres()
    total = np.zeros(len(centres))
    seeing = np.zeros(len(centres), int)
    for camera, counts in zip(rig, evidence, strict=True):
        inside, row, column, _ = camera.look_up(centres)
        seen = counts[row, column]
        known = seen != UNKNOWN
        total[inside] += np.where(known, seen, 0)
        seeing[inside] += known
    if body is not None:
        total = np.clip(total + body(centres), -127 * len(rig), 127 * len(rig))
    log_odds = np.log(config.prior / (1 - config.prior)) + total * step
    probability = np.where(
        seeing >= config.seeing_cameras(len(rig)), 1 / (1 + np.exp(-log_odds)), 0.0
    )
    return probability.reshape(padded.shape)

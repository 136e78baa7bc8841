"""The NumPy twin of `psfs.voxels.division.Division`."""

from __future__ import annotations

import numpy as np

from psfs.background.config import UNKNOWN
from psfs.cameras.camera import CameraRig
from psfs.voxels.division import BEFORE, REACH
from psfs.voxels.grid import VoxelGrid


def divide_voxels(grid: VoxelGrid, surface: np.ndarray, spheres: np.ndarray) -> list[np.ndarray]:
    """Return the flat indices of each person's voxels, of `surface` (N,), in their order.

    A voxel belongs to the person with the nearest of `spheres` (P, K, 4), m, by the tangent from
    the voxel's centre to the sphere, up to `REACH`; otherwise to nobody.
    """
    away = ((grid.centres(surface)[:, None, None] - spheres[..., :3]) ** 2).sum(-1)
    nearest = (away - spheres[..., 3] ** 2).min(-1)
    owner = np.where(nearest.min(1) < REACH**2, nearest.argmin(1), len(spheres))
    return [surface[owner == person] for person in range(len(spheres))]


def divide_evidence(rig: CameraRig, evidence: np.ndarray, spheres: np.ndarray) -> np.ndarray:
    """Return each person's evidence (P, V, H, W) int8.

    Foreground belongs to the people whose spheres' images cover it, or to the nearest, up to
    `REACH`; it is `UNKNOWN` to those that stand `BEFORE` behind another one there,
    and 0 to the rest. What is not foreground stays as it is for all.
    """
    height, width = evidence.shape[1:]
    own = np.zeros((len(spheres), *evidence.shape), np.int8)
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)
    for view, (camera, counts) in enumerate(zip(rig, evidence, strict=True)):
        gaps, depths = (np.full((len(spheres), height, width), np.inf) for _ in range(2))
        for person, each in enumerate(spheres):
            images, depth = camera.project(each[:, :3])
            for image, away, radius in zip(images, depth, each[:, 3], strict=True):
                if not away > 0:
                    continue
                tangent = (((pixels - image) * away / camera.K[0, 0]) ** 2).sum(-1) - radius**2
                gaps[person] = np.minimum(gaps[person], np.maximum(tangent, 0))
                front = np.where(tangent <= 0, away, np.inf)
                depths[person] = np.minimum(depths[person], front)
        hidden = np.isfinite(depths) & (depths.min(0) < depths - BEFORE)
        mine = (gaps <= gaps.min(0)) & (gaps < REACH**2)
        shared = np.where(hidden, UNKNOWN, np.where(mine, counts, 0))
        own[:, view] = np.where(counts > 0, shared, counts)
    return own

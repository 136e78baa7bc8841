"""Distances between clouds and the true surface of the person of `apf synth`, as benchmarks of
multi-view stereo state them: accuracy from the cloud to the surface, completeness the other way."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from apf.reference.synthetic.scene import body_distance
from apf.synthetic.config import SceneConfig
from apf.synthetic.generate import MARK
from apf.synthetic.render import SyntheticScene
from cl import Device
from psfs.common.toml import read_toml
from psfs.voxels.grid import VoxelCloud, VoxelGrid

#: Signed distances (N,) m of points (N, 3) to a closed surface, negative inside.
Surface = Callable[[np.ndarray], np.ndarray]

#: Distance, m, of neighbouring points of the true surface.
_SPACING = 0.01


def open_true_surface(folder: Path, device: Device) -> Callable[[int], Surface] | None:
    """Return a function from a frame's number to the surface of the one person of a sequence of
    `apf synth`; None for other folders."""
    if not (folder / MARK).is_file():
        return None
    file = folder / MARK
    config = SceneConfig.from_dict(read_toml(file)["synthetic"], str(file))
    scene = SyntheticScene(config, device)

    def surface(frame: int) -> Surface:
        primitives = scene.posed(frame)[0]
        return lambda points: body_distance(primitives, points)

    return surface


def score_surface(cloud: VoxelCloud, surface: Surface) -> dict[str, float]:
    """Return the mean distances, mm, of the cloud's voxels to the surface (`accuracy_mm`) and of
    the surface's points to the nearest voxel (`completeness_mm`), and the shares of both within a
    voxel's edge (`accurate`, `complete`)."""
    points, edge = find_surface_points(cloud.grid, surface), cloud.grid.voxel_size
    there = np.abs(surface(cloud.centres))
    back = cKDTree(cloud.centres).query(points)[0]
    return {
        "accuracy_mm": 1e3 * float(there.mean()),
        "completeness_mm": 1e3 * float(back.mean()),
        "accurate": float((there < edge).mean()),
        "complete": float((back < edge).mean()),
    }


def find_surface_points(grid: VoxelGrid, surface: Surface) -> np.ndarray:
    """Return points (N, 3) m within half of `_SPACING` of the surface in the grid's box."""
    coarse = 4 * _SPACING
    axes = [np.arange(low, high, coarse) for low, high in zip(grid.low, grid.high, strict=True)]
    blocks = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    blocks = blocks[np.abs(surface(blocks)) < coarse]
    steps = _SPACING * (np.stack(np.indices((4, 4, 4)), -1).reshape(-1, 3) - 1.5)
    points: np.ndarray = (blocks[:, None] + steps).reshape(-1, 3)
    return points[np.abs(surface(points)) < _SPACING / 2]

"""Normals of voxel clouds against those of the shapes that they were made of."""

import numpy as np

from psfs.reference.surface import surface_voxels
from psfs.voxels.clouds import estimate_normals
from psfs.voxels.grid import VoxelCloud, VoxelGrid

GRID = VoxelGrid(np.full(3, -0.5), 0.02, (50, 50, 50))


def surface_of(occupied: np.ndarray) -> VoxelCloud:
    indices = surface_voxels(occupied.reshape(GRID.shape))
    return VoxelCloud(GRID, indices, np.ones(len(indices), np.float32))


def test_normals_of_a_ball_point_outwards() -> None:
    cloud = surface_of(np.linalg.norm(GRID.centres(), axis=1) < 0.3)
    outwards = cloud.centres / np.linalg.norm(cloud.centres, axis=1, keepdims=True)
    normals = estimate_normals(cloud)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    degrees = np.degrees(np.arccos(np.clip((normals * outwards).sum(1), -1, 1)))
    assert degrees.mean() < 2 and degrees.max() < 5


def test_of_two_bodies_each_has_its_own() -> None:
    centres = GRID.centres()
    balls = [np.linalg.norm(centres - [x, 0, 0], axis=1) < 0.15 for x in (-0.25, 0.25)]
    cloud = surface_of(balls[0] | balls[1])
    middle = np.where(cloud.centres[:, :1] < 0, [[-0.25, 0, 0]], [[0.25, 0, 0]])
    assert ((cloud.centres - middle) * estimate_normals(cloud)).sum(1).min() > 0.1

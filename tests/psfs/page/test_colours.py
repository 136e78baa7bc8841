"""Colours of voxels and meshes."""

import io

import numpy as np
import trimesh
from helpers import scenes

from psfs.common.colours import CLAY
from psfs.page.clouds import make_surface
from psfs.page.colours import COLOURINGS, colour_vertices, colour_voxels
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelCloud, VoxelGrid


def cloud_of(count: int, coloured: bool = True) -> VoxelCloud:
    """Return `count` red voxels with probabilities up to 1."""
    grid = scenes.small_grid()
    indices = 10_000 + 7 * np.arange(count)
    colour = np.tile(np.uint8([255, 0, 0]), (count, 1)) if coloured else None
    probability = np.linspace(OccupancyConfig().threshold, 1, count).astype(np.float32)
    return VoxelCloud(grid, indices, probability, colour)


def test_colourings() -> None:
    cloud = cloud_of(9)
    np.testing.assert_array_equal(colour_voxels(cloud, "colour"), cloud.colour)
    clay = colour_voxels(cloud_of(9, coloured=False), "colour")
    np.testing.assert_allclose(clay / 255, np.tile(CLAY, (9, 1)), atol=1 / 255)
    unsure, sure = colour_voxels(cloud, "probability")[[0, -1]].astype(int)
    assert unsure[0] > 2 * unsure[1] and sure[1] > 2 * sure[0]  # red to green
    grid = VoxelGrid(np.array([0, 0, -0.1]), 0.1, (1, 1, 21))
    column = VoxelCloud(grid, np.arange(21), np.ones(21, np.float32))
    blue, red = colour_voxels(column, "height")[[0, -1]].astype(int)
    assert red[0] > red[2] + 50 and blue[2] > blue[1] + 20
    for colouring in COLOURINGS:
        assert colour_voxels(cloud_of(0), colouring).shape == (0, 3)


def test_meshes_take_the_nearest_voxels_colours() -> None:
    cloud = cloud_of(40)
    ball = trimesh.creation.icosphere(2, 0.3)
    ball.apply_translation(cloud.centres.mean(0))
    distance = np.linalg.norm(ball.vertices[:, None] - cloud.centres, axis=-1)
    expected = colour_voxels(cloud, "probability")[distance.argmin(1)]
    np.testing.assert_array_equal(colour_vertices(ball.vertices, cloud, "probability"), expected)
    glb = make_surface(ball, cloud, "probability").glb
    read = trimesh.load(io.BytesIO(glb), file_type="glb").to_geometry()
    assert np.allclose(read.bounds[:, 1], ball.bounds[:, 2], atol=1e-5)  # +Y is up
    assert b"COLOR_0" in glb

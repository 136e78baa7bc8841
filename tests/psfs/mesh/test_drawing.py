"""Drawings of clouds, meshes, cameras and the floor."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from helpers import scenes

from psfs.mesh.drawing import (
    COLOURINGS,
    SurfaceDrawing,
    colour_scale,
    draw_floor,
    draw_frusta,
    make_cubes,
    make_voxel_layer,
    voxel_colours,
)
from psfs.mesh.marching_cubes import CLAY
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelCloud, VoxelGrid


def cloud_of(count: int, coloured: bool = True) -> VoxelCloud:
    """Return `count` red voxels with probabilities up to 1."""
    grid = scenes.small_grid()
    indices = 10_000 + 7 * np.arange(count)
    colour = np.tile(np.uint8([255, 0, 0]), (count, 1)) if coloured else None
    probability = np.linspace(OccupancyConfig().threshold, 1, count).astype(np.float32)
    return VoxelCloud(grid, indices, probability, colour)


def test_voxels_are_shown_as_cubes_of_their_size() -> None:
    cloud = cloud_of(5)
    vertices, faces = make_cubes(cloud)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(5 * cloud.grid.voxel_size**3)
    np.testing.assert_allclose(vertices.reshape(5, 8, 3).mean(1), cloud.centres)
    assert len(make_cubes(cloud_of(0))[0]) == 0


def test_colourings() -> None:
    cloud = cloud_of(9)
    np.testing.assert_array_equal(voxel_colours(cloud, "colour"), cloud.colour)
    clay = voxel_colours(cloud_of(9, coloured=False), "colour")
    np.testing.assert_allclose(clay / 255, np.tile(CLAY, (9, 1)), atol=1 / 255)
    unsure, sure = voxel_colours(cloud, "probability")[[0, -1]].astype(int)
    assert unsure[2] > unsure[1] and sure[:2].min() > 200 > sure[2]  # violet to yellow
    z = cloud.centres[:, 2]
    by_height = voxel_colours(cloud, "height", z.min(), z.max()).astype(int)
    assert by_height[z.argmax(), 0] > by_height[z.argmax(), 2] + 50  # red
    assert by_height[z.argmin(), 2] > by_height[z.argmin(), 1] + 20  # blue
    for colouring in COLOURINGS:
        assert voxel_colours(cloud_of(0), colouring).shape == (0, 3)


def test_scales_run_as_the_colours_do() -> None:
    text, strip = colour_scale("height", -0.1, 2.0)
    assert text == "-0.1 to 2 m" and strip.shape == (12, 256, 3)
    grid = VoxelGrid(np.array([0, 0, -0.1]), 0.1, (1, 1, 21))
    column = VoxelCloud(grid, np.arange(21), np.ones(21, np.float32))
    there = np.rint(255 * (column.centres[:, 2] + 0.1) / 2.1).astype(int)
    np.testing.assert_array_equal(voxel_colours(column, "height", -0.1, 2.0), strip[0, there])
    assert colour_scale("probability", 0, 1)[0] == f"{OccupancyConfig().threshold:g} to 1"
    assert not len(colour_scale("colour", 0, 1)[1])


def test_the_layer_of_voxels_is_made_once() -> None:
    asked = []

    def shape(frame: int) -> tuple[VoxelCloud, None]:
        asked.append(frame)
        return cloud_of(frame), None

    layer = make_voxel_layer(shape, scenes.small_grid())
    first = layer.drawing(3, "colour")
    assert isinstance(first, SurfaceDrawing) and len(first.vertices) == len(first.colours) == 24
    assert layer.drawing(0, "colour") is None
    assert layer.drawing(3, "colour") is first
    other = layer.drawing(3, "height")
    assert isinstance(other, SurfaceDrawing) and other.vertices is first.vertices
    assert (other.colours != first.colours).any() and asked == [3, 0]


def test_meshes_take_the_nearest_voxels_colours() -> None:
    cloud = cloud_of(40)
    ball = trimesh.creation.icosphere(2, 0.3)
    ball.apply_translation(cloud.centres.mean(0))
    surface = make_voxel_layer(lambda _: (cloud, ball), cloud.grid).drawing(1, "probability")
    assert isinstance(surface, SurfaceDrawing)
    np.testing.assert_allclose(surface.vertices[surface.faces], ball.vertices[ball.faces])
    distance = np.linalg.norm(surface.vertices[:, None] - cloud.centres, axis=-1)
    expected = voxel_colours(cloud, "probability")[distance.argmin(1)]
    np.testing.assert_array_equal(surface.colours, expected)
    np.testing.assert_allclose(surface.normals[surface.faces], ball.vertex_normals[ball.faces])


def test_frusta_show_what_the_cameras_see() -> None:
    rig = scenes.ring(3)
    lines = draw_frusta(rig)
    assert len(lines.colours) == len(lines.pairs) > 3 * 8 - 1
    for view, camera in enumerate(rig):
        own = lines.points.reshape(3, -1, 3)[view]
        at_centre = np.linalg.norm(own - camera.centre, axis=1) < 1e-6
        assert at_centre.any()
        ahead = (own[~at_centre] - camera.centre) @ camera.R.T
        assert (ahead[:, 2] > 0).sum() >= 4
        x = ahead[:, 0] / ahead[:, 2] * camera.K[0, 0] + camera.K[0, 2]
        assert np.isclose(x[:, None], [0, camera.size[0]], atol=1).any(0).all()


def test_the_floor_lies_under_the_grid() -> None:
    grid = VoxelGrid(np.array([-0.7, -0.4, 0.2]), 0.1, (14, 8, 17))
    lines = draw_floor(grid)
    squares, axes = lines.pairs[:-3], lines.pairs[-3:]
    assert (lines.points[squares][..., 2] == 0).all()
    assert lines.points[:, :2].min() <= -0.7 - 1 and lines.points[:, :2].max() >= 0.7 + 1 - 0.3
    np.testing.assert_array_equal(np.diff(lines.points[axes], axis=1)[:, 0], np.eye(3))
    assert len(lines.colours) == len(lines.pairs)
    tiny = draw_floor(VoxelGrid(np.zeros(3), 0.001, (60, 40, 90)))
    assert np.ptp(tiny.points) < 0.2

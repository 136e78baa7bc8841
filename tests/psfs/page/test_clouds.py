"""Points of frames, within the memory that they may take, carved in the background, in colours."""

import io
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from helpers import scenes
from helpers.studio import GRID, save_voxels

from psfs.common.colours import CLAY
from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.page import clouds as module
from psfs.page.clouds import (
    COLOURINGS,
    CarvedClouds,
    KeptPoints,
    Points,
    StoredClouds,
    colour_vertices,
    colour_voxels,
    grid_centre,
    make_blocks,
    make_points,
    make_surface,
)
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelCloud, VoxelGrid


def points(n: int) -> Points:
    return Points(np.zeros((n, 3), np.float16), np.zeros((n, 3), np.uint8), 0.02)


def cloud(n: int) -> VoxelCloud:
    return VoxelCloud(GRID, np.arange(n, dtype=np.int32), np.ones(n, np.float32))


def test_least_used_points_are_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "KEPT_BYTES", 9 * 25)
    kept = KeptPoints()
    kept.put(0, points(10))
    kept.put(1, points(10))
    assert kept.get(0) is not None
    kept.put(2, points(10))
    assert kept.get(1) is None and kept.get(0) is not None and kept.nbytes == 180
    kept.put(3, points(1000))  # a frame larger than all that may be kept is still shown
    assert len(kept) == 1 and kept.get(3) is not None


def test_stored_voxels_become_points(tmp_path: Path) -> None:
    run = ReconstructionFolder.open(save_voxels(tmp_path / "voxels"))
    clouds = StoredClouds(run)
    found = clouds.get(2)
    assert found is not None and clouds.get(99) is None
    expected = run.cloud(2)
    off = found.positions.astype(float) + grid_centre(GRID) - expected.centres
    assert np.abs(off).max() < 0.001
    assert np.array_equal(found.colours, expected.colour)


def test_slow_browsers_get_blocks_in_mean_colours() -> None:
    cells = np.stack(np.meshgrid([3, 4, 5], [10, 11], [6, 7], indexing="ij"), -1).reshape(-1, 3)
    indices = np.ravel_multi_index(tuple(cells.T), GRID.shape).astype(np.int32)
    colours = np.stack([10 * cells[:, 0], cells[:, 1], cells[:, 2]], -1).astype(np.uint8)
    merged = make_blocks(VoxelCloud(GRID, indices, np.ones(12, np.float32)), colours, most=6)
    assert merged.size == 2 * GRID.voxel_size
    places = merged.positions.astype(float) + grid_centre(GRID) - GRID.origin
    assert np.allclose(places / merged.size, [[1.5, 5.5, 3.5], [2.5, 5.5, 3.5]], atol=0.05)
    assert merged.colours.tolist() == [[30, 10, 6], [45, 10, 6]]
    assert make_points(cloud(8000)).blocks is None
    many = make_points(cloud(9000))
    assert many.blocks is not None and many.nbytes > 9 * 9000


def test_voxels_are_carved_only_while_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    known: list[int] = []
    third = threading.Event()

    def carve() -> Iterator[tuple[int, VoxelCloud]]:
        for frame in range(3):
            yield frame, cloud(frame + 1)

    def note(frame: int) -> None:
        known.append(frame)
        if frame == 2:
            third.set()

    monkeypatch.setattr(module, "KEPT_BYTES", 9 * 5)  # has room for the last two
    clouds = CarvedClouds(GRID, 3, carve, note)
    assert clouds.get(0) is None and "0 of 3" in clouds.describe(0) and known == []
    clouds.want(True)
    assert third.wait(60)
    clouds.close()
    found = clouds.get(2)
    assert found is not None and len(found.positions) == 3 and clouds.describe(2) == ""
    assert clouds.get(0) is None
    assert clouds.describe(0) == "no voxels: memory holds those of 2 of 3 frames"


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

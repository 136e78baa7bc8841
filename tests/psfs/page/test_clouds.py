"""Points of frames: as stored, within the memory that they may take, carved in the background."""

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from helpers.studio import GRID, save_voxels

from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.page.clouds import (
    CarvedClouds,
    KeptPoints,
    Points,
    StoredClouds,
    grid_centre,
    make_blocks,
    make_points,
)
from psfs.voxels.grid import VoxelCloud


def points(n: int) -> Points:
    return Points(np.zeros((n, 3), np.float16), np.zeros((n, 3), np.uint8), 0.02)


def cloud(n: int) -> VoxelCloud:
    return VoxelCloud(GRID, np.arange(n, dtype=np.int32), np.ones(n, np.float32))


def test_least_used_points_are_dropped() -> None:
    kept = KeptPoints(most=9 * 25)
    kept.put(0, points(10))
    kept.put(1, points(10))
    assert kept.get(0) is not None
    kept.put(2, points(10))
    assert kept.get(1) is None and kept.get(0) is not None and kept.nbytes == 180
    kept.put(3, points(1000))  # a frame larger than all that may be kept is still shown
    assert len(kept) == 1 and kept.get(3) is not None


def test_stored_voxels_become_points(tmp_path: Path) -> None:
    run = ReconstructionFolder.open(save_voxels(tmp_path / "voxels"))
    clouds = StoredClouds(run, most=0)
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


def test_voxels_are_carved_only_while_wanted() -> None:
    known: list[int] = []
    third = threading.Event()

    def carve() -> Iterator[tuple[int, VoxelCloud]]:
        for frame in range(3):
            yield frame, cloud(frame + 1)

    def note(frame: int) -> None:
        known.append(frame)
        if frame == 2:
            third.set()

    clouds = CarvedClouds(GRID, 3, carve, note, most=9 * 5)  # has room for the last two
    assert clouds.get(0) is None and "0 of 3" in clouds.describe(0) and known == []
    clouds.want(True)
    assert third.wait(60)
    clouds.close()
    found = clouds.get(2)
    assert found is not None and len(found.positions) == 3 and clouds.describe(2) == ""
    assert clouds.get(0) is None
    assert clouds.describe(0) == "no voxels: memory holds those of 2 of 3 frames"

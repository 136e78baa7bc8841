"""Voxel occupancy on every OpenCL device against the NumPy twin."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import scenes

from cl import Device, DeviceError, InputError
from psfs.cameras.camera import CameraRig
from psfs.reference.surface import occupancy
from psfs.voxels.bricks import Bricks, Occupancy
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelGrid

STEP = 0.05


def both(
    device: Device, rig: CameraRig, grid: VoxelGrid, config: OccupancyConfig
) -> tuple[np.ndarray, np.ndarray]:
    evidence = scenes.patches_of_evidence(rig, len(rig), 8)
    maps = device.to_device(evidence)
    probability = Occupancy(Bricks(device, rig, grid, maps, STEP, config))().get()
    return probability, occupancy(rig, grid, evidence, STEP, config)


@pytest.mark.parity("reconstruction/occupancy.occupancy")
@pytest.mark.parametrize("distorted", [True, False])
@pytest.mark.parametrize("views", [1, 2, 5, 16])
def test_agrees_with_the_twin(device: Device, views: int, distorted: bool) -> None:
    rig = scenes.ring(views)
    rig = rig if distorted else scenes.without_distortion(rig)
    config = OccupancyConfig(prior=0.3, min_cameras=min(views, 2))
    probability, expected = both(device, rig, scenes.small_grid(), config)
    assert np.isfinite(probability).all()
    assert (np.abs(probability - expected) > 1e-5).mean() < 2e-3


def test_voxels_behind_and_around_the_cameras(device: Device) -> None:
    grid = VoxelGrid.covering(np.full(3, -6.0), np.full(3, 6.0), 0.31)
    config = OccupancyConfig(min_cameras=1)
    probability, expected = both(device, scenes.ring(3), grid, config)
    assert np.isfinite(probability).all()
    assert (expected == 0).any() and (expected > 0).any()
    assert (np.abs(probability - expected) > 1e-5).mean() < 2e-3


@pytest.mark.parametrize("shape", [(1, 1, 1), (3, 1, 70), (2, 5, 1)])
def test_odd_grids(device: Device, shape: tuple[int, int, int]) -> None:
    grid = VoxelGrid(np.array([-0.2, -0.1, 0.3]), 0.02, shape)
    probability, expected = both(device, scenes.ring(2), grid, OccupancyConfig())
    assert probability.shape == tuple(n + 2 for n in shape)
    assert (np.abs(probability - expected) > 1e-5).mean() < 0.05


def test_a_moved_grid_gives_what_a_new_one_gives(device: Device) -> None:
    rig, grid = scenes.ring(3), scenes.small_grid()
    moved = VoxelGrid(grid.origin + np.array([0.12, -0.06, 0.0]), grid.voxel_size, grid.shape)
    evidence = device.to_device(
        np.random.default_rng(0).integers(-127, 15, (3, rig.height, rig.width)).astype(np.int8)
    )
    bricks = Bricks(device, rig, grid, evidence, STEP)
    first, there = Occupancy(bricks), Occupancy(Bricks(device, rig, moved, evidence, STEP))
    bricks.move_to(moved)
    np.testing.assert_array_equal(first().get(), there().get())


def test_a_grid_beyond_32_bits_is_refused(device: Device) -> None:
    grid = VoxelGrid(np.zeros(3), 1e-6, (2000, 2000, 2000))
    with pytest.raises(InputError, match="8,000,000,000 voxels"):
        Occupancy(Bricks(device, scenes.ring(1), grid, device.empty(1, np.int8), STEP))


def test_a_grid_beyond_the_memory_is_refused(device: Device) -> None:
    n = 1200
    if device.info.memory > 4 * n**3:
        pytest.skip("this device has room for the grid")
    grid = VoxelGrid(np.zeros(3), 1e-6, (n, n, n))
    with pytest.raises(DeviceError, match="MiB"):
        Occupancy(Bricks(device, scenes.ring(1), grid, device.empty(1, np.int8), STEP))

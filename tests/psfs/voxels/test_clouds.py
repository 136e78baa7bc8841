"""Voxel clouds: written and read back, their parts, and their normals against known shapes."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from helpers import scenes

from psfs.reference.surface import surface_voxels
from psfs.voxels.clouds import (
    coarsen,
    estimate_normals,
    read_cloud,
    remove_debris,
    write_cloud,
)
from psfs.voxels.grid import VoxelCloud, VoxelGrid


def a_cloud(colour: bool = False, speck: bool = False) -> VoxelCloud:
    grid = scenes.small_grid()
    occupied = scenes.solid(grid.centres()).reshape(grid.shape)
    if speck:
        occupied[0, 0, :2] = True
    indices = surface_voxels(occupied)
    random = np.random.default_rng(1)
    colours = random.integers(0, 255, (len(indices), 3)).astype(np.uint8) if colour else None
    probability = random.uniform(0.5, 1, len(indices)).astype(np.float32)
    return VoxelCloud(grid, indices, probability, colours, occupied.sum() * 0.06**3)


@pytest.mark.parametrize("colour", [False, True])
def test_round_trip(tmp_path: Path, colour: bool) -> None:
    cloud = a_cloud(colour)
    write_cloud(cloud, tmp_path / "frame_000000", normals=True)
    again = read_cloud(tmp_path / "frame_000000.npz")
    np.testing.assert_array_equal(again.indices, cloud.indices)
    np.testing.assert_array_equal(again.probability, cloud.probability)
    np.testing.assert_allclose(again.centres, cloud.centres)
    assert again.volume == cloud.volume
    points = trimesh.load(tmp_path / "frame_000000.ply")
    np.testing.assert_allclose(points.vertices, cloud.centres, atol=1e-6)
    columns = points.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_array_equal(columns["probability"], cloud.probability)
    normals = np.stack([columns[name] for name in ("nx", "ny", "nz")], -1)
    np.testing.assert_array_equal(normals, estimate_normals(cloud))
    written = (tmp_path / "frame_000000.ply").read_bytes()
    assert b"unit metre; right-handed, Z up" in written
    if cloud.colour is not None:
        np.testing.assert_array_equal(points.colors[:, :3], cloud.colour)


def test_an_empty_cloud_is_written_and_read(tmp_path: Path) -> None:
    cloud = VoxelCloud(scenes.small_grid(), np.zeros(0, np.int32), np.zeros(0, np.float32))
    write_cloud(remove_debris(cloud), tmp_path / "empty")
    assert len(read_cloud(tmp_path / "empty.npz")) == 0
    assert b"element vertex 0\n" in (tmp_path / "empty.ply").read_bytes()


def test_debris_is_dropped() -> None:
    clean, dirty = a_cloud(), a_cloud(speck=True)
    kept = remove_debris(dirty)
    np.testing.assert_array_equal(kept.indices, clean.indices)
    assert kept.volume == pytest.approx(clean.volume)
    assert len(remove_debris(dirty, 0)) == len(dirty)


def test_a_coarser_cloud_covers_the_same_place() -> None:
    cloud = a_cloud(colour=True)
    coarse = coarsen(cloud, 3)
    offsets = cloud.centres[:, None] - coarse.centres
    assert np.abs(offsets).max(2).min(1).max() <= coarse.grid.voxel_size / 2
    assert len(coarse) < len(cloud) and coarsen(cloud, 1).grid.shape == cloud.grid.shape
    assert cloud.colour is not None and coarse.colour is not None
    assert set(map(tuple, coarse.colour)) <= set(map(tuple, cloud.colour))


GRID = VoxelGrid(np.full(3, -0.5), 0.02, (50, 50, 50))


def surface_of(occupied: np.ndarray) -> VoxelCloud:
    indices = surface_voxels(occupied.reshape(GRID.shape))
    return VoxelCloud(GRID, indices, np.ones(len(indices), np.float32))


def test_normals_of_balls_point_outwards() -> None:
    centres = GRID.centres()
    cloud = surface_of(np.linalg.norm(centres, axis=1) < 0.3)
    outwards = cloud.centres / np.linalg.norm(cloud.centres, axis=1, keepdims=True)
    normals = estimate_normals(cloud)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    degrees = np.degrees(np.arccos(np.clip((normals * outwards).sum(1), -1, 1)))
    assert degrees.mean() < 2 and degrees.max() < 5
    beside = np.linalg.norm(np.abs(centres) - [0.25, 0, 0], axis=1) < 0.15  # each has its own
    two = surface_of(beside)
    middle = np.sign(two.centres[:, :1]) * [0.25, 0, 0]
    assert ((two.centres - middle) * estimate_normals(two)).sum(1).min() > 0.1

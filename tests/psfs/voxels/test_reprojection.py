"""Reprojection of the voxels on every OpenCL device against its NumPy twin."""

import numpy as np
import pytest
from helpers import scenes
from scipy import ndimage

from cl import Device, NumpyDevice
from psfs.cameras.footprints import voxel_footprints
from psfs.reconstructor import Reconstructor
from psfs.reference.reprojection import NumpyReprojection, boundary, proximity, splat
from psfs.reference.surface import surface_voxels
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.host_voxels import HostVoxels, voxel_silhouette
from psfs.voxels.reprojection import Reprojection, edge_reach, proximity_table


def both(device: Device, rig, grid, masks, **options):
    voxels = Reconstructor(device, rig, grid, None)(scenes.frame(masks=masks))
    maps = Reprojection(device, rig, grid, **options)(voxels).get()
    surface = voxels.cloud().indices
    twin = HostVoxels(grid, voxels.probability.get(), surface, 0)
    return maps, NumpyReprojection(NumpyDevice(), rig, grid, **options)(twin)


@pytest.mark.parity(
    "reconstruction/reprojection.splat", "reconstruction/reprojection.edge_proximity"
)
@pytest.mark.parametrize("views", [1, 3])
def test_maps_agree_with_the_twin(device: Device, views: int) -> None:
    rig = scenes.ring(views)
    maps, expected = both(device, rig, scenes.small_grid(), scenes.masks_of(rig))
    assert expected[..., 0].any()
    assert (maps[..., 0] != expected[..., 0]).mean() < 1e-3
    assert (maps[..., 1] != expected[..., 1]).mean() < 2e-2  # a moved edge moves what is near it


def test_edges_are_exact_for_the_same_silhouette(device: Device) -> None:
    rig = scenes.ring(3)
    maps, _ = both(device, rig, scenes.small_grid(), scenes.masks_of(rig))
    sigma, radius = edge_reach(rig)
    for view, camera in enumerate(rig):
        edge = boundary(maps[view, ..., 0] > 0, camera.size)
        expected = proximity(edge, proximity_table(sigma, radius))
        np.testing.assert_array_equal(maps[view, ..., 1], expected)


def test_the_host_has_the_twins_silhouette() -> None:
    rig, grid = scenes.ring(3), VoxelGrid.covering(np.full(3, -4.0), np.full(3, 4.0), 0.25)
    occupied = np.random.default_rng(0).random(grid.shape) < 0.01
    centres = grid.centres(surface_voxels(occupied))
    for camera, footprint in zip(rig, voxel_footprints(rig, grid.voxel_size), strict=True):
        inputs = (camera, centres, footprint, (rig.height, rig.width))
        np.testing.assert_array_equal(voxel_silhouette(*inputs), splat(*inputs))


def test_voxels_around_and_behind_the_cameras(device: Device) -> None:
    rig = scenes.ring(3)
    grid = VoxelGrid.covering(np.full(3, -4.0), np.full(3, 4.0), 0.25)
    masks = np.full((3, rig.height, rig.width), 255, np.uint8)
    maps, expected = both(device, rig, grid, masks)
    assert (maps[..., 0] != expected[..., 0]).mean() < 2e-3


def test_solid_silhouettes_have_no_holes(device: Device) -> None:
    rig = scenes.ring(4)
    maps, _ = both(device, rig, scenes.small_grid(0.03), scenes.masks_of(rig))
    for silhouette in maps[..., 0] > 0:
        assert (ndimage.binary_fill_holes(silhouette) == silhouette).all()

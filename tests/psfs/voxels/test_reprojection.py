"""Reprojection of the voxels, and what pictures show that joins it: kernels against the twin."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers import scenes
from scipy import ndimage

from cl import Device, NumpyDevice
from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import voxel_footprints
from psfs.reconstructor import Reconstructor
from psfs.reference.reprojection import (
    NumpyReprojection,
    boundary,
    join_foreground,
    proximity,
    splat,
)
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


def test_solid_silhouettes_have_no_holes_and_exact_edges(device: Device) -> None:
    rig = scenes.ring(4)
    maps, _ = both(device, rig, scenes.small_grid(0.03), scenes.masks_of(rig))
    sigma, radius = edge_reach(rig)
    for view, camera in enumerate(rig):
        silhouette = maps[view, ..., 0] > 0
        assert (ndimage.binary_fill_holes(silhouette) == silhouette).all()
        edge = boundary(silhouette, camera.size)
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


def blobs(rig: CameraRig, seed: int = 0) -> np.ndarray:
    """(V, H, W) int8 evidence: blobs of all sizes, noise, and counts at the ends of their range."""
    random = np.random.default_rng(seed)
    shape = (len(rig), rig.height, rig.width)
    smooth = ndimage.gaussian_filter(random.normal(size=shape), (0, 4, 4))
    evidence = np.where(smooth > 0.08, 127, -127) * random.choice([0, 1], shape, p=[0.1, 0.9])
    evidence[random.random(shape) < 0.01] = 1
    return evidence.astype(np.int8)


@pytest.mark.parity(
    "reconstruction/foreground_join.person_box",
    "reconstruction/foreground_join.foreground_bits",
    "reconstruction/foreground_join.join_foreground",
)
@pytest.mark.parametrize("size", [(160, 120), (163, 117)])
def test_silhouettes_equal_the_twins(device: Device, size: tuple[int, int]) -> None:
    rig, grid = scenes.ring(3, size=size), scenes.small_grid()
    voxels = Reconstructor(device, rig, grid, None)(scenes.frame(masks=scenes.masks_of(rig)))
    alone = Reprojection(device, rig, grid)(voxels).get()[..., 0] > 0
    evidence = blobs(rig)
    voxels.evidence = device.to_device(evidence)
    found = Reprojection(device, rig, grid, join=True)(voxels).get()[..., 0] > 0
    expected = [join_foreground(s, e) for s, e in zip(alone, evidence, strict=True)]
    np.testing.assert_array_equal(found, expected)
    assert (found != alone).any() and alone.any()


def test_a_limb_that_was_carved_away_is_there_again_and_speckle_is_not() -> None:
    silhouette, evidence = np.zeros((120, 160), bool), np.full((120, 160), -50, np.int8)
    silhouette[30:100, 60:80] = True
    evidence[30:100, 60:80] = 50
    evidence[44:49, 80:100] = 50  # an arm of 5 x 20 px
    evidence[60, 90] = evidence[70:73, 95:98] = 50  # speckle
    evidence[40:60, 140:160] = 50  # somebody else, further away than a third of the height
    expected = silhouette.copy()
    expected[44:49, 80:100] = True
    np.testing.assert_array_equal(join_foreground(silhouette, evidence), expected)


def test_voxels_without_evidence_and_a_join_that_is_off_change_nothing(device: Device) -> None:
    rig, grid = scenes.ring(2), scenes.small_grid()
    voxels = Reconstructor(device, rig, grid, None)(scenes.frame(masks=scenes.masks_of(rig)))
    alone = Reprojection(device, rig, grid)(voxels).get()
    bare = SimpleNamespace(grid=grid, surface=voxels.surface, count=voxels.count, evidence=None)
    voxels.evidence = device.to_device(blobs(rig))
    for shown, join in ((bare, True), (voxels, False)):
        maps = Reprojection(device, rig, grid, join=join)(shown).get()  # type: ignore[arg-type]
        np.testing.assert_array_equal(maps, alone)

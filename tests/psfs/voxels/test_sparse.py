"""Voxels in the bricks that can be occupied, and their surface: kernels against the twin."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import scenes
from scipy import ndimage

from cl import Device, InputError
from psfs.cameras.camera import CameraRig
from psfs.reconstructor import Reconstructor
from psfs.reference.surface import blur, mean_position, occupancy, smooth, surface_voxels
from psfs.silhouettes.hidden import UNKNOWN
from psfs.voxels import sparse
from psfs.voxels.bricks import Bricks
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.moving_grid import SAMPLES, MeanPosition
from psfs.voxels.sparse import SparseSurface
from psfs.voxels.surface import SurfaceList

STEP = 0.05


def evidence_of(rig: CameraRig, seed: int, block: int) -> np.ndarray:
    """Mostly plain background."""
    return scenes.patches_of_evidence(rig, seed, block, 40, 0.5)


def compare(
    device: Device,
    rig: CameraRig,
    grid: VoxelGrid,
    evidence: np.ndarray,
    config: OccupancyConfig,
) -> tuple[int, int]:
    """Numbers of surface voxels and of active bricks, after comparing with the twin, and with all
    bricks."""
    maps = device.to_device(evidence)
    found = SparseSurface(Bricks(device, rig, grid, maps, STEP, config))
    for _ in range(2):  # the second time over what the first one left
        found()
    every = scenes.carve(Bricks(device, rig, grid, maps, STEP, config.replace(threshold=1e-9)))
    expected = smooth(occupancy(rig, grid, evidence, STEP, config), faces=True)
    assert np.isfinite(every).all()
    assert (np.abs(every - expected) > 1e-5).mean() < (0.05 if grid.size < 1000 else 1e-2)
    occupied, there = every > config.threshold, found.probability.get()
    near = ndimage.binary_dilation(occupied, np.ones((3, 3, 3)))
    np.testing.assert_array_equal(there[near], every[near])
    assert np.isin(there[~near], np.append(every[~near], 0)).all()
    surface = surface_voxels(occupied, config.closed_surface)
    # Voxels at the border of two pixels, or as probable as the threshold, may differ.
    twins = surface_voxels(expected > config.threshold, config.closed_surface)
    assert len(np.setxor1d(surface, twins)) <= max(2, 5e-3 * len(twins))
    np.testing.assert_array_equal(found.list.indices.get(len(surface)), surface)
    assert found.list.count.get()[0] == len(surface)
    assert found.list.occupied.get()[0] == occupied.sum()
    indices, chosen, n_occupied = found.download()
    np.testing.assert_array_equal(indices, surface)
    np.testing.assert_array_equal(chosen, every.ravel()[surface])
    assert n_occupied == occupied.sum()
    return len(surface), int(found.n_active.get()[0])


@pytest.mark.parametrize(("views", "distorted"), [(1, True), (5, False), (16, True)])
def test_bricks_are_left_out_where_nothing_is(device: Device, views: int, distorted: bool) -> None:
    rig = scenes.ring(views)
    rig = rig if distorted else scenes.without_distortion(rig)
    config = OccupancyConfig(prior=0.4, min_cameras=min(views, 2))
    for block in (1, 8, 40):
        evidence = evidence_of(rig, views, block)
        compare(device, rig, scenes.small_grid(0.04), evidence, config)


@pytest.mark.parity(
    "reconstruction/occupancy.find_bricks",
    "reconstruction/occupancy.sparse_occupancy",
    "reconstruction/pool.sparse_gather",
    "reconstruction/pool.spread",
)
@pytest.mark.parametrize(
    ("views", "shape"),
    [(3, (1, 1, 1)), (3, (3, 1, 70)), (3, (3, 30, 70)), (1, (33, 40, 32)), (3, (21, 28, 17))],
)
def test_grids_of_any_shape(device: Device, views: int, shape: tuple[int, int, int]) -> None:
    rig, grid = scenes.ring(views), VoxelGrid(np.array([-0.2, -0.1, 0.3]), 0.03, shape)
    config = OccupancyConfig(prior=0.4, min_cameras=1)
    compare(device, rig, grid, evidence_of(rig, 1, 6), config)
    evidence = scenes.patches_of_evidence(rig, 1, 8, 70, 0.2)  # mostly somebody
    count, _ = compare(device, rig, grid, evidence, config)
    assert count > 20 or grid.size < 1000


@pytest.mark.parametrize("value", [-60, 0, 14])
def test_uniform_evidence(device: Device, value: int) -> None:
    rig, grid = scenes.ring(4), scenes.small_grid(0.05)
    evidence = np.full((4, rig.height, rig.width), value, np.int8)
    count, active = compare(device, rig, grid, evidence, OccupancyConfig(prior=0.45))
    assert (count > 0) == (value > 0) and (active > 0) == (value > 0)


def test_most_bricks_are_left_out(device: Device) -> None:
    rig = scenes.without_distortion(scenes.ring(6, size=(240, 200)))
    frame = scenes.frame(masks=scenes.masks_of(rig))
    grid = VoxelGrid.covering(np.array([-2.0, -2, -0.1]), np.array([2.0, 2, 2.4]), 0.025)
    reconstructor = Reconstructor(device, rig, grid, None)
    assert len(reconstructor(frame).cloud())
    surface = reconstructor.surface
    assert 0 < surface.n_active.get()[0] < 0.25 * surface.slots.size


@pytest.mark.parity("reconstruction/tiles.evidence_tiles")
def test_tiles_hold_the_extremes(device: Device) -> None:
    rig = scenes.ring(3)
    maps = device.to_device(evidence_of(rig, 3, 3))
    bricks = Bricks(device, rig, scenes.small_grid(), maps, STEP)
    bricks()
    evidence, tiles = bricks.evidence.get(), bricks.tiles.get()
    at = 0
    for edge in (8, 32):
        for y in range(0, rig.height, edge):
            for x in range(0, rig.width, edge):
                tile = evidence[:, y : y + edge, x : x + edge]
                extremes = np.stack([tile.min((1, 2)), tile.max((1, 2))], -1)
                np.testing.assert_array_equal(tiles[:, at], extremes)
                at += 1
    assert at == tiles.shape[1]


def test_too_many_bricks_are_warned_of_once(
    device: Device, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Noise all over the pictures ends no track; what has no room is as likely as the threshold."""
    monkeypatch.setattr(sparse, "ROOM", 4096)
    rig, grid = scenes.ring(4), scenes.small_grid(0.04)
    evidence = device.to_device(np.full((4, rig.height, rig.width), 14, np.int8))
    config = OccupancyConfig()
    surface = SparseSurface(Bricks(device, rig, grid, evidence, STEP, config))
    surface()
    found = [surface.download()[1] for _ in range(2)][-1]
    assert (found >= np.float32(config.threshold)).all()
    assert (found == np.float32(config.threshold)).any() and (found > config.threshold).any()
    assert [record.message.count("bricks") for record in caplog.records] == [1]


@pytest.mark.parametrize(
    ("lens", "half", "voxel"),
    [
        (None, [6.0, 6.0, 6.0], 0.23),  # behind and around the cameras
        ([-0.9, 0.0, 0.0, 0.0, 0.0], [2.5, 2.5, 2.0], 0.07),  # turns back well inside
        ([-0.28, 0.0, 0.02, 0.015, -0.05], [2.5, 2.5, 2.0], 0.07),
    ],
)
def test_large_rooms_and_strong_lenses(
    device: Device, lens: list[float] | None, half: list[float], voxel: float
) -> None:
    """Bricks whose evidence is taken for uniform have the twin's occupancy, whatever the lens."""
    rig, config = scenes.ring(4, (161, 120)), OccupancyConfig(min_cameras=1, prior=0.4)
    if lens is not None:
        rig = CameraRig(tuple(replace(camera, distortion=np.array(lens)) for camera in rig))
    grid = VoxelGrid.covering(np.array([0, 0, 1.0]) - half, np.array([0, 0, 1.0]) + half, voxel)
    count, _ = compare(device, rig, grid, evidence_of(rig, 8, 8), config)
    assert count > 0


def test_a_grid_beyond_32_bits_is_refused(device: Device) -> None:
    grid = VoxelGrid(np.zeros(3), 1e-6, (2000, 2000, 2000))
    with pytest.raises(InputError, match="8,000,000,000 voxels"):
        Bricks(device, scenes.ring(1), grid, device.empty(1, np.int8), STEP)


SHAPES = [(1, 1, 1), (1, 7, 3), (17, 1, 33), (40, 23, 31), (9, 64, 65), (5, 6, 16), (4, 3, 32)]


@pytest.mark.parity("reconstruction/surface.count_slabs", "reconstruction/surface.list_surface")
@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_agrees_with_the_twin(device: Device, shape: tuple[int, int, int], closed: bool) -> None:
    occupied = np.random.default_rng(1).random(shape) < 0.9
    along = np.pad(occupied, ((0, 0), (0, 0), (0, -shape[2] % 16)))
    bits = np.packbits(along, axis=-1, bitorder="little").view("<u2")
    found = SurfaceList(device, shape, device.to_device(bits), closed)
    found()
    expected = surface_voxels(occupied, closed)
    assert found.count.get()[0] == len(expected)
    assert found.occupied.get()[0] == occupied.sum()
    np.testing.assert_array_equal(found.indices.get(len(expected)), expected)


@pytest.mark.parity("reconstruction/surface.mean_position")
@pytest.mark.parametrize("shape", [*SHAPES, (60, 50, 40)])
@pytest.mark.parametrize("share", [0.0, 0.7])
def test_the_mean_position_agrees_with_the_twin(
    device: Device, shape: tuple[int, int, int], share: float
) -> None:
    occupied = np.random.default_rng(3).random(shape) < share
    indices = surface_voxels(occupied)
    listed = device.to_device(indices if len(indices) else np.zeros(1, np.int32))
    count = device.to_device(np.array([len(indices)], np.int32))
    found = MeanPosition(device, shape, listed, count)()
    expected = mean_position(indices, shape, SAMPLES)
    assert (found is None) == (expected is None)
    if found is not None and expected is not None:
        np.testing.assert_allclose(found, expected, rtol=1e-5)


def blurred(rig: CameraRig, px: float) -> CameraRig:
    return CameraRig(tuple(replace(camera, blur=px) for camera in rig))


@pytest.mark.parity("reconstruction/blur.blur")
@pytest.mark.parametrize(("reach", "off", "px"), [(1, 0.0, 1), (1, 1.2, 2), (None, 2.0, 2)])
def test_blurred_evidence(device: Device, reach: float | None, off: float, px: int) -> None:
    """Evidence reaches a pixel, and farther where the calibration is off."""
    rig, config = blurred(scenes.ring(3), off), OccupancyConfig(reach=reach)
    evidence = evidence_of(rig, 5, 7)
    evidence[:, 10:30, 5:40][evidence[:, 10:30, 5:40] < 0] = UNKNOWN
    bricks = Bricks(device, rig, scenes.small_grid(), device.to_device(evidence), STEP, config)
    bricks()
    expected = blur(evidence, px)
    np.testing.assert_array_equal(bricks.evidence.get(), expected)
    assert (expected > 0).sum() > (evidence > 0).sum() and (expected == UNKNOWN).any()


def test_thin_limbs_survive_cameras_that_are_off(device: Device) -> None:
    """A rod of two voxels that every other camera shows two pixels aside."""
    rig, grid = scenes.ring(6), scenes.small_grid(0.02)
    middle = grid.origin + grid.voxel_size * np.array(grid.shape) / 2
    rod = middle + np.linspace(-0.1, 0.1, 200)[:, None] * np.array([0, 0, 1])
    evidence = np.full((len(rig), rig.height, rig.width), -90, np.int8)
    for view, camera in enumerate(rig):
        _, row, column, _ = camera.look_up(rod)
        evidence[view, row, column + 2 * (view % 2)] = 14
    n_voxels = []
    for px in (0, 1, 2):
        maps, off = device.to_device(evidence), blurred(rig, px)
        config = OccupancyConfig(reach=min(px, 1))
        surface = SparseSurface(Bricks(device, off, grid, maps, STEP, config))
        surface()
        n_voxels.append(len(surface.download()[0]))
    assert n_voxels[0] == 0 and n_voxels[2] > 10

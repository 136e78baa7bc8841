"""Smoothing, threshold and surface voxels on every OpenCL device against the NumPy twin."""

from __future__ import annotations

import numpy as np
import pytest

from cl import Device
from psfs.reference.surface import mean_position, smooth, surface_voxels
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.moving_grid import SAMPLES, MeanPosition
from psfs.voxels.surface import Surface

SHAPES = [(1, 1, 1), (1, 7, 3), (17, 1, 33), (40, 23, 31), (9, 64, 65), (5, 6, 16), (4, 3, 32)]


CUBE = OccupancyConfig(threshold=0.501, smoothing="cube", closed_surface=False)
FACES = CUBE.replace(threshold=0.9, smoothing="faces", closed_surface=True)


def run(device: Device, padded: np.ndarray, config: OccupancyConfig = CUBE) -> Surface:
    shape = tuple(n - 2 for n in padded.shape)
    occupancy = device.to_device(padded.astype(np.float32))
    surface = Surface(device, shape, occupancy, config)
    surface()
    return surface


@pytest.mark.parity(
    "reconstruction/surface.smooth",
    "reconstruction/surface.threshold",
    "reconstruction/surface.count_slabs",
    "reconstruction/surface.list_surface",
    "reconstruction/surface.gather",
)
@pytest.mark.parametrize("shape", SHAPES)
def test_agrees_with_the_twin(device: Device, shape: tuple[int, int, int]) -> None:
    # Multiples of 1/64: their sums are exact, no voxel sits on the threshold by rounding.
    padded = np.random.default_rng(1).integers(0, 65, [n + 2 for n in shape]) / 64
    surface = run(device, padded)
    expected = smooth(padded)
    np.testing.assert_allclose(surface.probability.get(), expected, atol=1e-6)
    occupied = expected > 0.501
    count = int(surface.list.count.get()[0])
    np.testing.assert_array_equal(surface.list.indices.get(count), surface_voxels(occupied))
    assert int(surface.list.occupied.get()[0]) == occupied.sum()
    np.testing.assert_allclose(
        surface.surface_probability(count), expected.ravel()[surface_voxels(occupied)], atol=1e-6
    )


@pytest.mark.parametrize("shape", SHAPES)
def test_the_closed_surface_of_faces_agrees_with_the_twin(
    device: Device, shape: tuple[int, int, int]
) -> None:
    padded = (np.random.default_rng(4).random([n + 2 for n in shape]) < 0.96).astype(float)
    surface = run(device, padded, FACES)
    smoothed = smooth(padded, faces=True)
    np.testing.assert_allclose(surface.probability.get(), smoothed, atol=1e-6)
    occupied = smoothed > 0.9
    expected = surface_voxels(occupied, closed=True)
    count = int(surface.list.count.get()[0])
    np.testing.assert_array_equal(surface.list.indices.get(count), expected)
    if min(shape) > 20:  # neither of the two surfaces is the other, nor all that is occupied
        assert len(surface_voxels(occupied)) < len(expected) < occupied.sum()


@pytest.mark.parity("reconstruction/surface.mean_position")
@pytest.mark.parametrize("shape", [*SHAPES, (60, 50, 40)])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.7])
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

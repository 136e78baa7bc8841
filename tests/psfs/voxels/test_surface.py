"""Surface voxels on every OpenCL device against the NumPy twin."""

import numpy as np
import pytest

from cl import Device
from psfs.reference.surface import mean_position, surface_voxels
from psfs.voxels.moving_grid import SAMPLES, MeanPosition
from psfs.voxels.surface import SurfaceList

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

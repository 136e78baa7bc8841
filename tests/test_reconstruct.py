"""The reconstruction on every OpenCL device against its NumPy twin."""

from __future__ import annotations

import numpy as np
import pytest
import scenes

from cl import Device, NumpyDevice
from psfs.reconstruct import Reconstructor
from psfs.reference.reconstruct import NumpyReconstructor


def agree(device: Device, rig, grid, background, frame, config=None, share=2e-3):
    """Compare probabilities but for a share of voxels whose pixel rounding decides."""
    voxels = Reconstructor(device, rig, grid, background, config)(frame)
    twin = NumpyReconstructor(NumpyDevice(), rig, grid, background, config)(frame)
    probability = voxels.probability.get()
    assert np.isfinite(probability).all()
    off = np.abs(probability - twin.probability) > 1e-4
    # Each voxel touches 27 smoothed ones.
    assert off.mean() <= 27 * share
    cloud, expected = voxels.cloud(), twin.cloud()
    assert np.all(np.diff(cloud.indices) > 0)
    np.testing.assert_array_equal(cloud.probability, probability.ravel()[cloud.indices])
    union = np.union1d(cloud.indices, expected.indices)
    common = np.intersect1d(cloud.indices, expected.indices)
    assert len(union) - len(common) <= max(2, 0.01 * len(union))
    assert cloud.volume == pytest.approx(expected.volume, rel=5e-3, abs=1e-9)
    return cloud


@pytest.mark.parametrize("views", [1, 2, 5])
def test_pictures_agree_with_the_twin(device: Device, views: int) -> None:
    rig = scenes.ring(views)
    frame, background = scenes.pictures_of(rig)
    cloud = agree(device, rig, scenes.small_grid(), background, frame)
    assert len(cloud) > 0


def test_masks_agree_with_the_twin(device: Device) -> None:
    rig = scenes.without_distortion(scenes.ring(4))
    frame = scenes.Picture(masks=scenes.masks_of(rig))
    cloud = agree(device, rig, scenes.small_grid(), None, frame)
    inside = scenes.solid(cloud.grid.centres())
    # A hull contains its body; with four cameras it is not much larger.
    assert 0.9 * inside.sum() * 0.06**3 < cloud.volume < 2.2 * inside.sum() * 0.06**3

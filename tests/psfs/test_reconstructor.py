"""The reconstruction on every OpenCL device against its NumPy twin."""

from pathlib import Path

import numpy as np
import pytest
from helpers import scenes

from cl import Device, NumpyDevice
from psfs.reconstructor import Reconstructor
from psfs.reference.reconstructor import NumpyReconstructor
from psfs.voxels.grid import VoxelGrid


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


def test_masks_agree_with_the_twin(device: Device) -> None:
    rig = scenes.without_distortion(scenes.ring(4))
    frame = scenes.frame(masks=scenes.masks_of(rig))
    cloud = agree(device, rig, scenes.small_grid(), None, frame)
    inside = scenes.solid(cloud.grid.centres())
    # A hull contains its body; with four cameras it is not much larger.
    assert 0.9 * inside.sum() * 0.06**3 < cloud.volume < 2.2 * inside.sum() * 0.06**3


def walk(rig, steps: int = 4):
    """Frames in which the test body moves along x by 0.12 m each."""
    masks = (scenes.masks_of(rig, [0.12 * step, 0, 0]) for step in range(steps))
    return [scenes.frame(step, masks=shown) for step, shown in enumerate(masks)]


def test_a_stream_gives_what_single_calls_give(device: Device) -> None:
    rig, grid = scenes.without_distortion(scenes.ring(4)), scenes.small_grid()
    frames = walk(rig)
    alone = Reconstructor(device, rig, grid, None)
    streamed = Reconstructor(device, rig, grid, None)
    for frame, voxels in zip(frames, streamed.stream(frames), strict=True):
        expected, cloud = alone(frame).cloud(), voxels.cloud()
        np.testing.assert_array_equal(cloud.indices, expected.indices)
        np.testing.assert_array_equal(cloud.probability, expected.probability)


def test_a_following_grid_keeps_the_person_inside(device: Device) -> None:
    rig = scenes.without_distortion(scenes.ring(5))
    size = 0.05
    room = VoxelGrid.covering(np.array([-1.5, -1.5, 0.0]), np.array([1.5, 1.5, 1.8]), size)
    small = VoxelGrid(room.origin + size * np.array([16, 16, 0]), size, (28, 28, 36))
    whole = Reconstructor(device, rig, room, None)
    follows = Reconstructor(device, rig, small, None, follow=True)
    for frame in walk(rig, 6):
        expected, voxels = whole(frame).cloud(), follows(frame)
        cloud = voxels.cloud()
        assert np.all(cloud.grid.origin[2] == room.origin[2])
        steps = (cloud.grid.origin - room.origin) / size
        np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
        ours = {tuple(p) for p in np.rint(cloud.centres * 1000).astype(int)}
        theirs = {tuple(p) for p in np.rint(expected.centres * 1000).astype(int)}
        assert len(ours ^ theirs) <= 0.01 * len(theirs)
    assert follows.grid.origin[0] < small.origin[0] or follows.grid.origin[0] > small.origin[0]


def test_many_frames_take_no_more_memory_than_fifty() -> None:
    statm = Path("/proc/self/statm")
    if not statm.exists():
        pytest.skip("asks Linux for this process's memory")
    rig, grid = scenes.ring(3, (64, 48)), scenes.small_grid(0.1)
    device = Device.best(profile=True)
    picture, background = scenes.pictures_of(rig)
    frames = (scenes.frame(index, picture.images) for index in range(400))
    resident = {}
    for done, voxels in enumerate(Reconstructor(device, rig, grid, background).stream(frames), 1):
        voxels.cloud(colour=True)
        resident[done] = int(statm.read_text().split()[1])
    assert resident[400] <= 1.1 * resident[50]

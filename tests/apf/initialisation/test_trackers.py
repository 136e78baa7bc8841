"""The trackers of a start: one for each set of settings, whatever body comes next."""

import logging

import numpy as np
import pytest
from helpers.worlds import World

from apf.filters.config import FilterConfig
from apf.initialisation.automatic import Trackers
from apf.initialisation.kept_voxels import StoredVoxels
from cl import Device
from psfs.voxels.grid import VoxelCloud

FEW = FilterConfig.create(n_particles=37, n_layers=1)


def test_a_tracker_serves_the_next_body(device: Device, caplog: pytest.LogCaptureFixture) -> None:
    """And no kernel is built for it."""
    world = World(device)
    scene, trackers = world.scene(), Trackers(world.scene())
    first = trackers(scene.body, FEW)
    first.start(world.pose(0))
    first.step(world.voxels(0))
    taller = scene.body.scaled(dict.fromkeys(scene.body.scale_groups, 1.2), 1.2)
    with caplog.at_level(logging.INFO, "cl.device"):
        assert trackers(taller, FEW) is first
        assert first.body is taller
        first.start(world.pose(0))
        first.step(world.voxels(0))
    assert not [record for record in caplog.records if "built" in record.message]
    assert trackers(taller, FEW.with_changes(n_particles=38)) is not first


def test_kept_voxels_are_observed_once() -> None:
    device = Device.best(profile=True)
    world = World(device)
    surfaces = [world.twin(frame).surface.astype(np.int32) for frame in range(2)]
    kept = [
        StoredVoxels(
            device, VoxelCloud(world.grid, indices, np.ones(len(indices), np.float32), None, 0.0)
        )
        for indices in surfaces
    ]
    tracker = Trackers(world.scene())(world.scene().body, FEW)
    assert device.profiler is not None

    def found(voxels: object) -> np.ndarray:
        tracker.start(world.pose(0))
        return tracker.step(voxels).pose

    first = found(kept[0])
    device.profiler.clear()
    again = found(kept[0])
    assert "splat" not in device.profiler.collect()
    np.testing.assert_array_equal(first, again)
    other = found(kept[1])
    assert len(device.profiler.collect()["splat"]) == 1
    assert not np.array_equal(first, other)
    np.testing.assert_array_equal(first, found(kept[0]))

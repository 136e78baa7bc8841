"""The trackers of a start: one for each set of settings, whatever body comes next."""

from __future__ import annotations

import logging

import pytest
from helpers.worlds import World

from apf.filters.config import FilterConfig
from apf.initialisation.pose_search import Trackers
from cl import Device

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

"""Every search over every objective, on the device and as twins, through the same pipeline."""

import json
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest

from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.filters.method import Method
from apf.filters.searches import OBJECTIVES, SEARCHES
from apf.takes.start import read_given_start
from apf.tracking.pipeline import TrackingRun, TrackingTask, track_people
from apf.tracking.track import Track
from cl import Device, NumpyDevice
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings
from psfs.volume import automatic_grid
from psfs.voxels.grid import VoxelGrid

#: What a twin takes minutes for is left out.
TWINS = [("pso", "sp"), ("sir", "voxel")]


@pytest.fixture(scope="module")
def start(small_walk: Path) -> tuple[Sequence, VoxelGrid, BodyModel, np.ndarray]:
    """A walk, a coarse grid around the person, the body and its first pose."""
    sequence = Sequence.open(small_walk)
    found = read_given_start(sequence.folder, 0, None, small_walk / "truth.npz", "y-up")
    assert found is not None
    joints = posed_joints(found[0], found[1][None])[0]
    grid = VoxelGrid.covering(joints.min(0) - 0.3, joints.max(0) + 0.3, 0.05)
    return sequence, grid, *found


def tracked(device: Device | NumpyDevice, start, method: Method, n_frames: int) -> Track:
    """The first frames' track; only voxels need the grid."""
    sequence, grid, body, pose = start
    session = Session(sequence, device, SessionSettings(selection=slice(n_frames)))
    if method.uses_voxels:
        session.replace_result(automatic_grid, grid)
    run = TrackingRun(session, TrackingTask(body, pose, method, [0]))
    return track_people([run])[0].tracks[0]


#: Each objective by some search, and each search over voxels and pictures by a second one.
PAIRS = {*zip(cycle(SEARCHES), OBJECTIVES, strict=False), ("sir", "voxel"), ("apf", "sp")}


@pytest.mark.parametrize(("search", "objective"), sorted(PAIRS))
def test_on_the_device(start, search: str, objective: str) -> None:
    pose = start[3]
    size = {"n_particles": 60} if search == "sir" else {"n_particles": 40, "n_layers": 3}
    method = Method.create(search, objective, limb_search_reach=0.0, **size)
    track = tracked(Device.best(), start, method, 2)
    assert track.frames.tolist() == [0, 1]
    assert track.diagnostics["ess"].shape == (2, 1 if search == "sir" else 3)
    assert np.abs(track.poses - pose).max() < 1.0
    provenance = json.loads(track.provenance)
    assert (provenance["method"], provenance["objective"]) == (search, objective)
    assert ("grid" in provenance) == method.uses_voxels
    if method.uses_images:
        assert provenance["image"]["kind"] == objective
        assert np.all(track.diagnostics["best_log_weight"] <= 0)
        assert np.all(track.diagnostics["best_log_weight"] >= -1)


@pytest.mark.parametrize(("search", "objective"), TWINS)
def test_twins(start, search: str, objective: str) -> None:
    size = {"n_particles": 3} if search == "sir" else {"n_particles": 2, "n_layers": 2}
    settings = {"first_survival": 0.6, "last_survival": 0.6, "limb_search_reach": 0.0}
    method = Method.create(search, objective, n_points=40, refinement_steps=0, **size, **settings)
    tracks = [tracked(device, start, method, 1) for device in (NumpyDevice(), Device.best())]
    # One voxel of 650 at the threshold is rounded differently, which changes the surface's samples.
    tolerance = 0.015 if method.uses_voxels else 2e-3
    np.testing.assert_allclose(tracks[0].poses, tracks[1].poses, atol=tolerance)

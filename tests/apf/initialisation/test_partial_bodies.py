"""Starts and recovery of bodies that are a part of the person only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.walkers import GRID, SONG, surface_voxels, walker

from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.filters.method import Method
from apf.initialisation.automatic import find_start
from apf.initialisation.config import AcceptanceConfig, HeadingConfig, PoseSearchConfig, StartConfig
from apf.initialisation.start import StartError, check_startable
from apf.scene import Scene
from apf.tracking.trackers import make_recovering_tracker
from cl import Device

PARTS = ("rymut31_lower", "rymut31_upper")
#: A small search: these voxels are exact, and the heading is clear.
FAST = StartConfig(
    headings=HeadingConfig(n_headings=4, n_kept=2),
    search=PoseSearchConfig(
        n_particles_body=100, n_particles_limb=50, n_particles_near=40, n_limb_starts=1
    ),
    acceptance=AcceptanceConfig(n_attempts=1),
)


def error(body: BodyModel, pose: np.ndarray, true: np.ndarray) -> float:
    """Mean distance, m, of the joints from those of song31 in the pose `true`."""
    reached, expected = posed_joints(body, pose[None])[0], posed_joints(SONG, true[None])[0]
    columns = [SONG.joint_names.index(name) for name in body.joint_names]
    return float(np.linalg.norm(reached - expected[columns], axis=-1).mean())


def test_a_body_that_cannot_be_stood_says_what_it_lacks() -> None:
    with pytest.raises(StartError, match=r"stick: its root l_lower has no axes tx|tz; expected"):
        check_startable(bodies.named("stick"))
    trunk = load_body("rymut31_upper")
    trunk = replace(trunk, joints=tuple(j for j in trunk.joints if j.name != "head_top"), edges=())
    with pytest.raises(StartError, match="do not show how tall the person is; expected two of"):
        check_startable(trunk)


@pytest.mark.parametrize("name", PARTS)
def test_partial_bodies_are_found_by_themselves(name: str) -> None:
    """Of the person's size: kernels are compiled anew for every other one."""
    device, body = Device.best(), load_body(name)
    scene = Scene(device, scenes.ring(4), GRID, body)
    pose = walker(0)
    for dof in ("l_forearm.ry", "r_forearm.ry"):
        pose[SONG.dof_names.index(dof)] = 1.2  # without legs the front shows by these alone
    voxels = [surface_voxels(device, pose)]
    found = find_start(scene, voxels, 0.5, keep_shape=True, config=FAST)
    assert error(body, found.pose, pose) < 0.12


@pytest.mark.parametrize("name", PARTS)
def test_partial_bodies_are_not_lost_for_the_parts_that_they_lack(name: str) -> None:
    """And are found again where the person jumps, though the rest of him is never explained."""
    device, body = Device.best(), load_body(name)
    scene = Scene(device, scenes.ring(4), GRID, body)
    start = np.array([walker(0)[SONG.dof_names.index(dof)] for dof in body.dof_names])
    poses = [*(walker(k) for k in range(3)), *(walker(k, 0.45) for k in range(3, 5))]
    method = Method.create(n_particles=100, n_layers=6, part_colour_weight=0.0)  # no pictures
    tracker = make_recovering_tracker(scene, method)
    tracker.start(start)
    estimates = [tracker.step(surface_voxels(device, pose)) for pose in poses]
    assert not any(estimate.lost for estimate in estimates)
    for estimate, true in zip(estimates, poses, strict=True):
        assert error(body, estimate.pose, true) < 0.15

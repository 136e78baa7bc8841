"""Starts and recovery of bodies that are a part of the person only."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.walkers import GRID, SONG, surface_voxels, walker

from apf.body.kinematics import posed_cones, posed_joints
from apf.body.model import BodyModel
from apf.body.stature import has_feet, is_whole, lowest_point, stature
from apf.body.toml import load_body
from apf.filters.method import Method
from apf.initialisation.automatic import find_start, highest_point, standing_pose
from apf.initialisation.body_fit import Cloud
from apf.initialisation.start import StartConfig, StartError, check_startable
from apf.scene import Scene
from apf.tracking.recovery import make_recovering_tracker
from cl import Device

PARTS = ("rymut31_lower", "rymut31_upper")
#: The part that is tracked: kernels are compiled anew for every body, and what stands on feet is
#: tested with whole ones.
TRACKED = "rymut31_upper"
METHOD = Method.create(n_particles=100, n_layers=6, part_colour_weight=0.0)  # no pictures
#: A small search: these voxels are exact, and the heading is clear. The filter is that of the
#: recovery, whose kernels are compiled for it once.
FAST = StartConfig(n_headings=4, filter=METHOD.filter)


def error(body: BodyModel, pose: np.ndarray, true: np.ndarray) -> float:
    """Mean distance, m, of the joints from those of song31 in the pose `true`."""
    reached, expected = posed_joints(body, pose[None])[0], posed_joints(SONG, true[None])[0]
    columns = [SONG.joint_names.index(name) for name in body.joint_names]
    return float(np.linalg.norm(reached - expected[columns], axis=-1).mean())


def test_a_body_that_cannot_be_stood_says_what_it_lacks() -> None:
    with pytest.raises(StartError, match="stick: its root l_lower has no axes tz; expected"):
        check_startable(bodies.named("stick"))
    trunk = load_body("rymut31_upper")
    trunk = replace(trunk, joints=tuple(j for j in trunk.joints if j.name != "head_top"), edges=())
    with pytest.raises(StartError, match="do not show how tall the person is; expected two of"):
        check_startable(trunk)


def test_partial_bodies_are_found_by_themselves() -> None:
    """Of the person's size: kernels are compiled anew for every other one."""
    device, body = Device.best(), load_body(TRACKED)
    scene = Scene(device, scenes.ring(4), GRID, body)
    # Without legs the front shows by the forearms alone.
    pose = bodies.bent(SONG, walker(0), l_forearm__ry=1.2, r_forearm__ry=1.2)
    voxels = [surface_voxels(device, pose)]
    found = find_start(scene, voxels, 0.5, keep_shape=True, config=FAST)
    assert error(body, found.pose, pose) < 0.12


def test_partial_bodies_are_as_tall_as_what_is_seen() -> None:
    """The whole person's height decides, also where the body shows half of it."""
    device = Device.best()
    points = surface_voxels(device, walker(0)).cloud().centres
    for name in PARTS:
        body = load_body(name)
        small = body.scaled(dict.fromkeys(body.scale_groups, 0.9), 0.9)
        for other in (body, small):
            cloud = Cloud(points)
            cones = posed_cones(other, standing_pose(other, cloud, 0.0)[None])[0]
            if has_feet(other):
                assert lowest_point(cones) == pytest.approx(cloud.heights[0])
            else:
                assert highest_point(cones) == pytest.approx(cloud.heights[1])
        assert stature(small) == pytest.approx(0.9 * stature(body), rel=1e-6)
        assert stature(body) == pytest.approx(stature(load_body("rymut31")), rel=0.01)
        assert is_whole(SONG) and not is_whole(body)


def test_partial_bodies_are_not_lost_for_the_parts_that_they_lack() -> None:
    """And are found again where the person jumps, though the rest of him is never explained."""
    device, body = Device.best(), load_body(TRACKED)
    scene = Scene(device, scenes.ring(4), GRID, body)
    start = np.array([walker(0)[SONG.dof_names.index(dof)] for dof in body.dof_names])
    poses = [*(walker(k) for k in range(3)), *(walker(k, 0.45) for k in range(3, 5))]
    tracker = make_recovering_tracker(scene, METHOD)
    tracker.start(start)
    estimates = [tracker.step(surface_voxels(device, pose)) for pose in poses]
    assert not any(estimate.lost for estimate in estimates)
    for estimate, true in zip(estimates, poses, strict=True):
        assert error(body, estimate.pose, true) < 0.15

"""Starts and recovery of bodies that are a part of the person only."""

from __future__ import annotations

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
from apf.initialisation.automatic import find_start
from apf.initialisation.config import AcceptanceConfig, HeadingConfig, PoseSearchConfig, StartConfig
from apf.initialisation.hypotheses import highest_point, standing_pose
from apf.initialisation.shape_fit import Cloud
from apf.initialisation.start import StartError, check_startable
from apf.scene import Scene
from apf.tracking.trackers import make_recovering_tracker
from cl import Device

PARTS = ("rymut31_lower", "rymut31_upper", "armless")
#: Those that are searched and tracked: PoCL compiles a body's kernels in 6 s.
SHIPPED = PARTS[:2]
#: A small search: these voxels are exact, and the heading is clear.
FAST = StartConfig(
    headings=HeadingConfig(n_headings=4, n_kept=2),
    search=PoseSearchConfig(
        n_particles_body=100, n_particles_limb=50, n_particles_near=40, n_limb_starts=1
    ),
    acceptance=AcceptanceConfig(n_attempts=1),
)


def without(body: BodyModel, *words: str) -> BodyModel:
    """`body` without the bones, cones and joints whose names hold one of the words."""
    kept = [i for i, bone in enumerate(body.bones) if not any(w in bone.name for w in words)]
    new = {old: i for i, old in enumerate(kept)} | {-1: -1}
    dofs = sorted(axis.dof for i in kept for axis in body.bones[i].axes)
    bones = tuple(
        replace(
            body.bones[i],
            parent=new[body.bones[i].parent],
            axes=tuple(replace(a, dof=dofs.index(a.dof)) for a in body.bones[i].axes),
        )
        for i in kept
    )
    cones = [i for i, cone in enumerate(body.cones) if cone.bone in new]
    joints = [i for i, joint in enumerate(body.joints) if joint.bone in new]
    arrays = ("lower", "upper", "sigma", "rest_pose", "posture_sigma", "posture_rise")
    return replace(
        body,
        name="armless",
        bones=bones,
        cones=tuple(replace(body.cones[i], bone=new[body.cones[i].bone]) for i in cones),
        joints=tuple(replace(body.joints[i], bone=new[body.joints[i].bone]) for i in joints),
        dof_names=tuple(body.dof_names[dof] for dof in dofs),
        edges=_kept_pairs(body.edges, joints),
        apart=_kept_pairs(body.apart, cones),
        **{name: getattr(body, name)[dofs] for name in arrays},
    )


def _kept_pairs(pairs: tuple, kept: list[int]) -> tuple:
    return tuple((kept.index(a), kept.index(b)) for a, b in pairs if a in kept and b in kept)


def part(name: str) -> BodyModel:
    if name == "armless":
        return without(load_body("rymut31"), "clavicle", "arm")
    return load_body(name)


def error(body: BodyModel, pose: np.ndarray, true: np.ndarray) -> float:
    """Mean distance, m, of the joints from those of song31 in the pose `true`."""
    reached, expected = posed_joints(body, pose[None])[0], posed_joints(SONG, true[None])[0]
    columns = [SONG.joint_names.index(name) for name in body.joint_names]
    return float(np.linalg.norm(reached - expected[columns], axis=-1).mean())


def test_partial_bodies_know_the_whole_persons_stature() -> None:
    whole = stature(load_body("rymut31"))
    for name in PARTS:
        assert stature(part(name)) == pytest.approx(whole, rel=0.01)
    assert is_whole(part("armless")) and is_whole(SONG)
    assert not is_whole(part("rymut31_lower")) and not is_whole(part("rymut31_upper"))


def test_a_body_that_cannot_be_stood_says_what_it_lacks() -> None:
    with pytest.raises(StartError, match=r"stick: its root l_lower has no axes tx|tz; expected"):
        check_startable(bodies.named("stick"))
    trunk = without(load_body("rymut31_upper"), "head")
    trunk = replace(trunk, joints=tuple(j for j in trunk.joints if j.name != "head_top"))
    with pytest.raises(StartError, match="do not show how tall the person is; expected two of"):
        check_startable(trunk)


@pytest.mark.parametrize("name", SHIPPED)
def test_partial_bodies_are_found_by_themselves(name: str) -> None:
    """Of the person's size: kernels are compiled anew for every other one."""
    device, body = Device.best(), part(name)
    scene = Scene(device, scenes.ring(4), GRID, body)
    pose = walker(0)
    for dof in ("l_forearm.ry", "r_forearm.ry"):
        pose[SONG.dof_names.index(dof)] = 1.2  # without legs the front shows by these alone
    voxels = [surface_voxels(device, pose)]
    found = find_start(scene, voxels, 0.5, keep_shape=True, config=FAST)
    assert error(body, found.pose, pose) < 0.12


def test_partial_bodies_are_as_tall_as_what_is_seen() -> None:
    """The whole person's height decides, also where the body shows half of it."""
    device = Device.best()
    points = surface_voxels(device, walker(0)).cloud().centres
    for name in PARTS:
        body = part(name)
        small = body.scaled(dict.fromkeys(body.scale_groups, 0.9), 0.9)
        for other in (body, small):
            cloud = Cloud(points)
            cones = posed_cones(other, standing_pose(other, cloud, 0.0)[None])[0]
            if has_feet(other):
                assert lowest_point(cones) == pytest.approx(cloud.heights[0])
            else:
                assert highest_point(cones) == pytest.approx(cloud.heights[1])
        assert stature(small) == pytest.approx(0.9 * stature(body), rel=1e-6)


@pytest.mark.parametrize("name", SHIPPED)
def test_partial_bodies_are_not_lost_for_the_parts_that_they_lack(name: str) -> None:
    """And are found again where the person jumps, though the rest of him is never explained."""
    device, body = Device.best(), part(name)
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

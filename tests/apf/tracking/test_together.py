"""Several people on one reconstruction: their expected places, and their tracks."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.kinds import Unoptimised
from helpers.worlds import World

from apf.backend import make_device_tracker
from apf.body.cones import count_spheres
from apf.body.toml import load_body
from apf.filters.method import Method
from apf.reference.likelihood.voxel import expect_spheres
from apf.tracking.together import SLOTS, ExpectedBodies, PeopleTracker
from cl import Device, InputError


@pytest.mark.parity("tracking/people.expect_spheres")
def test_expected_places_equal_the_twin(device: Device) -> None:
    body, random = load_body("song31"), np.random.default_rng(0)
    spheres = device.zeros((2, count_spheres(body), 4), np.float32)
    places = ExpectedBodies(device, [body, body], spheres)
    poses = body.rest_pose + 0.1 * random.normal(size=(2, 4, body.n_dof))
    for person in range(2):
        places.start(person, poses[person, 0])
        for frame in range(1, 4):
            given = device.to_device(poses[person, frame].astype(np.float32))
            places.pose_launches(device, person, given)[frame % SLOTS]()
    places.expect(3, 2)
    expected = [expect_spheres(body, own[3], own[2], 2) for own in poses]
    np.testing.assert_allclose(spheres.get(), expected, atol=2e-5)
    places.start(1, poses[1, 0])  # at rest from now on
    places.expect(3, 2)
    at_rest = expect_spheres(body, poses[1, 0], poses[1, 0], 2)
    np.testing.assert_allclose(spheres.get()[1], at_rest, atol=2e-5)


def test_joined_launches_track_everybody_as_single_ones_do(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not device.is_gpu:  # CPUs join none
        programs = Unoptimised(device.programs, "batch_member")
        monkeypatch.setattr(device, "programs", programs)
    world, method = World(device), Method.create(n_particles=37, n_layers=2)
    everybody = world.voxels(0)
    maps = (len(world.rig), world.rig.height, world.rig.width)
    everybody.evidence = device.zeros(maps, np.int8)
    taller = world.body.scaled(dict.fromkeys(world.body.scale_groups, 1.12))
    poses = [world.pose(0), world.pose(0)]
    poses[1][list(world.body.dof_names).index("pelvis.tx")] += 0.3
    found = []
    for joins in (True, False):
        bodies = [world.body, taller]
        people = PeopleTracker(device, world.rig, everybody, bodies, method, joins=joins)
        people.start(poses)
        streamed = people.stream(world.voxels(frame) for frame in range(1, 4))
        found.append([[estimate.pose for estimate in estimates] for estimates in streamed])
        if joins:
            assert people.n_joined > 50
    np.testing.assert_array_equal(*found)


def test_one_person_is_tracked_as_alone_and_a_second_elsewhere_takes_nothing(
    device: Device,
) -> None:
    world, method = World(device), Method.create(n_particles=37, n_layers=3)
    first = world.pose(0)
    alone = make_device_tracker(world.scene(), method)
    alone.start(first)
    expected = [alone.step(world.voxels(frame)).pose for frame in range(1, 4)]
    everybody = world.voxels(0)
    maps = (len(world.rig), world.rig.height, world.rig.width)
    everybody.evidence = device.zeros(maps, np.int8)
    elsewhere = first.copy()
    elsewhere[list(world.body.dof_names).index("pelvis.tx")] += 1.5
    for poses in ([first], [first, elsewhere]):
        bodies = [world.body] * len(poses)
        people = PeopleTracker(device, world.rig, everybody, bodies, method)
        people.start(poses)
        stepped = [people.step(world.voxels(frame)) for frame in range(1, 4)]
        people.start(poses)
        streamed = list(people.stream(world.voxels(frame) for frame in range(1, 4)))
        for found in (stepped, streamed):
            np.testing.assert_array_equal([estimates[0].pose for estimates in found], expected)
        if len(poses) > 1:
            assert streamed[-1][1].misfit > 2 * streamed[-1][0].misfit


def test_bodies_and_poses_are_those_of_the_same_people(device: Device) -> None:
    world, method = World(device), Method.create(n_particles=40, n_layers=1)
    with pytest.raises(InputError, match="list of bodies is empty"):
        PeopleTracker(device, world.rig, world.voxels(0), [], method)
    people = PeopleTracker(device, world.rig, world.voxels(0), [world.body], method)
    with pytest.raises(InputError, match="2 poses for 1 people"):
        people.start([world.pose(0), world.pose(0)])

"""Several people on one reconstruction: their expected places, and their tracks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from helpers import scenes
from helpers.kinds import Unoptimised
from helpers.worlds import World

from apf.backend import make_device_tracker
from apf.body.cones import count_spheres
from apf.body.kinematics import posed_cones, posed_joints
from apf.body.toml import load_body
from apf.filters.method import Method
from apf.reference.likelihood.voxel import expect_spheres
from apf.tracking.together import SLOTS, ExpectedBodies, PeopleTracker
from cl import Device, InputError
from psfs.cameras.footprints import voxel_footprints
from psfs.common.cones import cone_distances
from psfs.reconstructor import Reconstructor
from psfs.voxels.device_voxels import Voxels
from psfs.voxels.host_voxels import voxel_silhouette


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


class Film:
    """Masks of the bodies of a world in its frames, and the voxels carved from them."""

    def __init__(self, world: World, offsets: Sequence[float]) -> None:
        self.world, self.offsets = world, offsets
        self.carve = Reconstructor(world.device, world.rig, world.grid, None)

    def pose(self, person: int, frame: int) -> np.ndarray:
        """The pose of a person, moved aside."""
        pose = self.world.pose(frame)
        pose[list(self.world.body.dof_names).index("pelvis.tx")] += self.offsets[person]
        return pose

    def voxels(self, frame: int) -> Voxels:
        rig = self.world.rig
        masks = np.zeros((len(rig), rig.height, rig.width), np.uint8)
        for person in range(len(self.offsets)):
            cones = posed_cones(self.world.body, self.pose(person, frame)[None])[0]
            centres = self.world.grid.centres()
            inside = centres[cone_distances(centres, cones).min(1) < 0.02]
            prints = voxel_footprints(rig, self.world.grid.voxel_size)
            for mask, camera, extent in zip(masks, rig, prints, strict=True):
                mask[voxel_silhouette(camera, inside, extent, mask.shape)] = 255
        return self.carve(scenes.frame(index=frame, masks=masks))


def test_joined_launches_track_everybody_as_single_ones_do(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not device.is_gpu:  # CPUs join none
        programs = Unoptimised(device.programs, "batch_member")
        monkeypatch.setattr(device, "programs", programs)
    film, method = Film(World(device), (0.0, 0.3)), Method.create(n_particles=37, n_layers=2)
    body = film.world.body
    bodies = [body, body.scaled(dict.fromkeys(body.scale_groups, 1.12))]
    found = []
    for joins in (True, False):
        people = PeopleTracker(
            device, film.world.rig, film.carve.voxels, bodies, method, joins=joins
        )
        people.start([film.pose(person, 0) for person in (0, 1)])
        streamed = people.stream(film.voxels(frame) for frame in range(1, 3))
        found.append([[estimate.pose for estimate in estimates] for estimates in streamed])
        if joins:
            assert people.n_joined > 50
    np.testing.assert_array_equal(*found)


def test_one_person_is_tracked_as_alone_and_one_of_two_takes_nothing_of_the_other(
    device: Device,
) -> None:
    method = Method.create(n_particles=60, n_layers=4)
    film = Film(World(device), (0.0,))
    alone = make_device_tracker(film.world.scene(), method)
    alone.start(film.pose(0, 0))
    expected = [alone.step(film.voxels(frame)).pose for frame in (1, 2)]
    body, rig = film.world.body, film.world.rig
    people = PeopleTracker(device, rig, film.carve.voxels, [body], method)
    people.start([film.pose(0, 0)])
    stepped = [people.step(film.voxels(frame))[0].pose for frame in (1, 2)]
    np.testing.assert_array_equal(stepped, expected)
    two = Film(World(device), (-0.35, 0.35))
    people = PeopleTracker(device, rig, two.carve.voxels, [body, body], method)
    people.start([two.pose(person, 0) for person in (0, 1)])
    stepped = [people.step(two.voxels(frame)) for frame in (1, 2)]
    for person in (0, 1):
        joints = posed_joints(body, np.stack([stepped[1][person].pose, two.pose(person, 2)]))
        assert np.linalg.norm(joints[0] - joints[1], axis=-1).mean() < 0.08


def test_bodies_and_poses_are_those_of_the_same_people(device: Device) -> None:
    world, method = World(device), Method.create(n_particles=40, n_layers=1)
    with pytest.raises(InputError, match="list of bodies is empty"):
        PeopleTracker(device, world.rig, world.voxels(0), [], method)
    people = PeopleTracker(device, world.rig, world.voxels(0), [world.body], method)
    with pytest.raises(InputError, match="2 poses for 1 people"):
        people.start([world.pose(0), world.pose(0)])

"""Tracks of several people on one reconstruction."""

from collections.abc import Sequence

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.worlds import World

from apf.backend import make_device_tracker
from apf.body.kinematics import posed_cones, posed_joints
from apf.filters.base import Estimate
from apf.filters.method import Method
from apf.tracking.together import PeopleTracker
from cl import Device, InputError
from psfs.cameras.rig_geometry import voxel_footprints
from psfs.common.cones import cone_distances
from psfs.reconstructor import Reconstructor
from psfs.voxels.device_voxels import Voxels
from psfs.voxels.host_voxels import voxel_silhouette


class Film:
    """Masks of the bodies of a world in its frames, and the voxels carved from them."""

    def __init__(self, world: World, offsets: Sequence[float]) -> None:
        self.world, self.offsets = world, offsets
        self.carve = Reconstructor(world.device, world.rig, world.grid, None)

    def pose(self, person: int, frame: int) -> np.ndarray:
        """The pose of a person, moved aside."""
        pose = self.world.pose(frame)
        return bodies.bent(self.world.body, pose, pelvis__tx=self.offsets[person])

    def miss(self, person: int, frame: int, estimate: Estimate) -> float:
        """The joints' mean distance, m, from the true ones."""
        poses = np.stack([estimate.pose, self.pose(person, frame)])
        found, true = posed_joints(estimate.body, poses)
        return float(np.linalg.norm(found - true, axis=-1).mean())

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


def test_a_stream_tracks_everybody_of_a_size_of_their_own(device: Device) -> None:
    film, method = Film(World(device), (-0.35, 0.35)), Method.create(n_particles=37, n_layers=2)
    body = film.world.body
    two = [body, body.scaled(dict.fromkeys(body.scale_groups, 1.12))]
    people = PeopleTracker(device, film.world.rig, film.carve.voxels, two, method)
    people.start([film.pose(person, 0) for person in (0, 1)])
    for estimates in people.stream(film.voxels(frame) for frame in range(1, 4)):
        assert [estimate.body for estimate in estimates] == two
    assert max(film.miss(person, 3, estimates[person]) for person in (0, 1)) < 0.15


def test_one_is_tracked_as_alone_and_of_two_each_apart(
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
    assert max(two.miss(person, 2, stepped[1][person]) for person in (0, 1)) < 0.08


def test_bodies_and_poses_are_those_of_the_same_people(device: Device) -> None:
    world, method = World(device), Method.create(n_particles=40, n_layers=1)
    with pytest.raises(InputError, match="list of bodies is empty"):
        PeopleTracker(device, world.rig, world.voxels(0), [], method)
    people = PeopleTracker(device, world.rig, world.voxels(0), [world.body], method)
    with pytest.raises(InputError, match="2 poses for 1 people"):
        people.start([world.pose(0), world.pose(0)])

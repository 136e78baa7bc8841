"""What each device gets: kernels on OpenCL, twins on NumPy, of one kind and one result."""

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.worlds import World

from apf.backend import (
    draw_poses,
    make_device_tracker,
    make_feature_extractor,
    make_feature_observer,
    make_tracker,
)
from apf.body.mesh import cone_mesh
from apf.filters.annealed import AnnealedParticleFilter
from apf.filters.base import DeviceTracker, Tracker
from apf.filters.method import Method
from apf.filters.searches import SEARCHES
from apf.filters.sir import SirParticleFilter
from apf.filters.swarm import ParticleSwarm
from apf.image_objective.features import Features
from apf.reference.filters.annealed import NumpyAnnealedParticleFilter
from apf.reference.filters.base import NumpyTracker
from apf.reference.filters.sir import NumpySirParticleFilter
from apf.reference.filters.swarm import NumpyParticleSwarm
from apf.reference.image_objective.features import NumpyFeatures
from apf.scene import Scene
from cl import Device, DeviceError, NumpyDevice

DEVICE = {"apf": AnnealedParticleFilter, "pso": ParticleSwarm, "sir": SirParticleFilter}
NUMPY = {
    "apf": NumpyAnnealedParticleFilter,
    "pso": NumpyParticleSwarm,
    "sir": NumpySirParticleFilter,
}
STICK = bodies.named("stick")


@pytest.mark.parametrize("search", SEARCHES)
def test_trackers(device: Device, search: str) -> None:
    world = World(device, voxel=0.1)
    method = Method.create(search, n_particles=100)
    on_device = make_tracker(world.scene(), method)
    twin = make_tracker(world.scene(NumpyDevice()), method)
    assert type(on_device) is DEVICE[search] and type(twin) is NUMPY[search]
    assert isinstance(on_device, DeviceTracker) and isinstance(twin, NumpyTracker)
    assert isinstance(on_device, Tracker) and isinstance(twin, Tracker)


def test_numpy_has_no_tracker_on_a_device(device: Device) -> None:
    world = World(device, STICK, voxel=0.2)
    with pytest.raises(DeviceError):
        make_device_tracker(world.scene(NumpyDevice()), Method())


@pytest.mark.parametrize("kind", ["opencl", "numpy"])
def test_observers_take_outlines_without_pictures(device: Device, kind: str) -> None:
    chosen = device if kind == "opencl" else NumpyDevice()
    world = World(device, STICK, voxel=0.2)
    masks = scenes.masks_of(world.rig)

    class Footage:
        rig, background, has_images = world.rig, None, False

    method = Method.create("pso", "sp")
    seen = make_feature_observer(chosen, Footage(), method.features)(scenes.frame(masks=masks))
    assert type(seen) is type(make_feature_extractor(chosen, world.rig, None))
    assert type(seen) is (Features if kind == "opencl" else NumpyFeatures)
    assert seen.config == method.features.replace(edges="outline")  # there are no pictures


@pytest.mark.parametrize("shape", ["trapezoids", "round ends", "mesh"])
def test_pictures_of_both_devices_are_the_same_but_for_the_boundary(
    device: Device, shape: str
) -> None:
    body, rig = STICK, scenes.ring(2, (161, 123))
    mesh = cone_mesh(body, 66) if shape == "mesh" else None
    poses = np.stack([body.rest_pose, 0.9 * body.rest_pose])
    drawn, expected = (
        draw_poses(Scene(chosen, rig, None, body), poses, mesh, shape == "round ends")
        for chosen in (device, NumpyDevice())
    )
    assert drawn.shape == expected.shape == (2, 2, 123, 161, 2) and expected[..., 0].any()
    assert np.count_nonzero(drawn != expected) <= 4 + 2e-3 * np.count_nonzero(expected[..., 0])

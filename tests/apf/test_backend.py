"""What each device gets: kernels on OpenCL, twins on NumPy, of one kind and one result."""

import pytest
from helpers import bodies, scenes
from helpers.worlds import World

from apf.backend import make_device_tracker, make_feature_observer
from apf.filters.method import Method
from apf.image_objective.features import Features
from apf.reference.image_objective.features import NumpyFeatures
from cl import Device, DeviceError, NumpyDevice

STICK = bodies.named("stick")


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
    assert type(seen) is (Features if kind == "opencl" else NumpyFeatures)
    assert seen.config == method.features.replace(edges="outline")  # there are no pictures

"""A voxel likelihood on the device with poses and maps of the test's own choice."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy import ndimage

from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.likelihood.voxel import VoxelLikelihood
from apf.reference.likelihood.voxel import NumpyVoxelLikelihood
from apf.scene import Scene
from cl import Device, NumpyDevice
from helpers import bodies, scenes
from psfs.cameras.camera import Camera, CameraRig
from psfs.reconstructor import Reconstructor
from psfs.reference.reconstructor import NumpyReconstructor
from psfs.voxels.grid import VoxelGrid

CONFIG = FilterConfig.create(n_particles=37, n_points=100)
#: Looks along -x at a cone on the z axis, 1 px per cm at the origin.
FRONT = Camera(
    "front",
    np.array([[200.0, 0, 50], [0, 200, 60], [0, 0, 1]]),
    np.zeros(5),
    np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]]),
    np.array([0.0, 0, 2]),
    (101, 121),
)


def smooth_maps(rig: CameraRig, seed: int = 0) -> np.ndarray:
    """(V, H, W, 2) uint8 from 0 to 255 without steps, so that a sample which rounding moves to the
    next pixel finds nearly the same value."""
    random = np.random.default_rng(seed)
    noise = random.normal(size=(len(rig), rig.height, rig.width, 2))
    noise = ndimage.gaussian_filter(noise, (0, 6, 6, 0))
    noise = (noise - noise.min()) / np.ptp(noise)
    return np.rint(255 * noise).astype(np.uint8)


class Setup:
    """A `VoxelLikelihood` with `poses` and `smooth_maps` on the device."""

    def __init__(
        self,
        device: Device,
        body: BodyModel,
        rig: CameraRig,
        poses: np.ndarray,
        config: FilterConfig,
        grid: VoxelGrid | None = None,
    ) -> None:
        self.body, self.rig, self.maps = body, rig, smooth_maps(rig)
        self.poses = poses.astype(np.float32)
        self.config = config.likelihood
        self.scene = Scene(device, rig, grid or scenes.small_grid(0.1), body)
        self.likelihood = VoxelLikelihood(self.scene, self.config, len(poses))
        self.likelihood.points.fill(0)
        self.on_device = device.to_device(self.poses)

    def errors(self, turn: int = 0) -> np.ndarray:
        self.likelihood.errors.fill(-7)
        self.likelihood.seen["maps"].set(self.maps)
        self.likelihood.n_launchers = turn
        for launch in self.likelihood.launcher(self.on_device):
            launch()
        return self.likelihood.errors.get()

    def expected(self, points: np.ndarray, turn: int = 0) -> np.ndarray:
        twin = NumpyVoxelLikelihood(replace(self.scene, device=NumpyDevice()), self.config)
        twin._maps, twin.points, twin.turn = self.maps, points, turn
        return twin(self.poses.astype(float))


def only(name: str, **settings: Any) -> FilterConfig:
    """Settings by which one term alone counts, once."""
    terms = ("edge", "silhouette", "surface", "overlap", "posture")
    weights: Any = {f"{term}_weight": float(term == name) for term in terms}
    weights["posture_prior_weight"] = weights.pop("posture_weight")
    return CONFIG.with_changes(**weights, **settings)


def observe_pictures(
    device: Device, rig: CameraRig, images: np.ndarray
) -> tuple[VoxelLikelihood, NumpyVoxelLikelihood, Any]:
    """Return a likelihood and its twin that have observed these pictures (V, H, W, 3) uint8 in the
    test body's silhouettes, and the voxels of the first."""
    grid, body, config = scenes.small_grid(0.08), bodies.named("song31"), CONFIG.likelihood
    picture: Any = scenes.frame(images=images, masks=scenes.masks_of(rig))
    ours = VoxelLikelihood(Scene(device, rig, grid, body), config, 37)
    voxels = Reconstructor(device, rig, grid, None)(picture)
    ours.observe(voxels)
    twin = NumpyVoxelLikelihood(Scene(NumpyDevice(), rig, grid, body), config)
    twin.observe(NumpyReconstructor(NumpyDevice(), rig, grid, None)(picture))
    return ours, twin, voxels


def assert_cost_nothing(device: Device, **weights: float) -> None:
    """Terms that look at pictures leave the errors as they are where frames have masks alone."""
    rig, grid, body = scenes.ring(2), scenes.small_grid(0.1), bodies.named("song31")
    picture: Any = scenes.frame(masks=scenes.masks_of(rig))
    poses = bodies.random_poses(body, 8).astype(np.float32)
    found = []
    for chosen in (dict.fromkeys(weights, 0.0), weights):
        config = FilterConfig.create(**chosen).likelihood
        likelihood = VoxelLikelihood(Scene(device, rig, grid, body), config, len(poses))
        likelihood.observe(Reconstructor(device, rig, grid, None)(picture))
        for launch in likelihood.launcher(device.to_device(poses)):
            launch()
        found.append(likelihood.errors.get())
    np.testing.assert_array_equal(*found)

"""A body that moves before cameras."""

from functools import lru_cache

import numpy as np

from apf.body.model import BodyModel
from apf.scene import Scene
from cl import Device, NumpyDevice
from helpers import bodies, scenes
from psfs.cameras.camera import CameraRig
from psfs.reconstructor import Reconstructor
from psfs.voxels.device_voxels import Voxels
from psfs.voxels.host_voxels import HostVoxels

SONG = bodies.named("song31")


class World:
    """A body that moves before cameras: its voxels on the device and for the twin."""

    def __init__(self, device: Device, body: BodyModel = SONG, voxel: float = 0.05) -> None:
        self.device, self.body = device, body
        self.rig: CameraRig = scenes.ring(3)
        self.grid = scenes.small_grid(voxel)
        self._voxels: Voxels = Reconstructor(device, self.rig, self.grid, None).voxels
        self._voxels.evidence = None  # the voxels here are carved from no pictures

    def scene(self, device: Device | NumpyDevice | None = None) -> Scene:
        """The world for what tracks in it, by default on its own device."""
        return Scene(device or self.device, self.rig, self.grid, self.body)

    def pose(self, frame: int) -> np.ndarray:
        pose = self.body.rest_pose.copy()
        for name, speed in (("pelvis.tx", 0.012), ("l_upper_arm.ry", 0.04), ("r_thigh.ry", 0.03)):
            if name in self.body.dof_names:
                pose[self.body.dof_names.index(name)] += speed * frame
        return pose

    def twin(self, frame: int) -> HostVoxels:
        inside, shell = _voxels(self.body, self.pose(frame).tobytes(), self.grid.voxel_size)
        return HostVoxels(self.grid, inside.reshape(self.grid.shape).astype(float), shell, 0)

    def voxels(self, frame: int) -> Voxels:
        indices = self.twin(frame).surface.astype(np.int32)
        padded = np.zeros(self._voxels.surface.size, np.int32)
        padded[: len(indices)] = indices
        self._voxels.surface.set(padded)
        self._voxels.count.set(np.array([len(indices)], np.int32))
        return self._voxels


@lru_cache(maxsize=100)
def _voxels(body: BodyModel, pose: bytes, voxel: float) -> tuple[np.ndarray, np.ndarray]:
    return bodies.voxels_of(body, np.frombuffer(pose), scenes.small_grid(voxel))

"""Device, cameras, voxel grid and body, which do not change while a person is tracked."""

from __future__ import annotations

from dataclasses import dataclass

from apf.body.model import BodyModel
from cl import Device, DeviceError, InputError, NumpyDevice
from psfs.cameras.camera import CameraRig
from psfs.voxels.grid import VoxelGrid


@dataclass(frozen=True, eq=False)
class Scene:
    """Common input of likelihoods, objectives and filters.

    device: that computes, or a NumpyDevice for the twins. rig: V calibrated cameras. grid: that
    voxels are reconstructed in; None for image objectives, which use no voxels. body: that is
    tracked, with D degrees of freedom.
    """

    device: Device | NumpyDevice
    rig: CameraRig
    grid: VoxelGrid | None
    body: BodyModel

    @property
    def opencl(self) -> Device:
        """The device for running kernels. Raises DeviceError if it is a NumpyDevice."""
        if not isinstance(self.device, Device):
            raise DeviceError(f"the device is {self.device.name}; expected an OpenCL device")
        return self.device

    @property
    def voxel_grid(self) -> VoxelGrid:
        """The voxel grid. Raises InputError if the scene has none."""
        if self.grid is None:
            raise InputError("the scene has no voxel grid; expected one")
        return self.grid

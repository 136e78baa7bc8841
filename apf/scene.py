"""What stays the same while somebody is tracked: device, cameras, voxel grid, body."""

from __future__ import annotations

from dataclasses import dataclass

from apf.body.model import BodyModel
from cl import Device, DeviceError, InputError, NumpyDevice
from psfs.cameras.camera import CameraRig
from psfs.voxels.grid import VoxelGrid


@dataclass(frozen=True, eq=False)
class Scene:
    """The four things that likelihoods, objectives and filters all need.

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
        """The device, for what runs kernels on it. Raises DeviceError if it is a NumpyDevice."""
        if not isinstance(self.device, Device):
            raise DeviceError(f"the device is {self.device.name}; expected an OpenCL device")
        return self.device

    @property
    def voxel_grid(self) -> VoxelGrid:
        """The grid, for what needs one. Raises InputError if there is none."""
        if self.grid is None:
            raise InputError("a scene without a voxel grid; expected one to look at voxels in")
        return self.grid

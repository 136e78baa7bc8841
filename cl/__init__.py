"""Compute on OpenCL devices: choose one, build kernels, keep arrays there, time what runs.

    import cl

    device = cl.Device.best()  # or cl.select_device("cpu"), "numpy", part of a name
    array = device.to_device(values)

A `Device` is made by the caller and passed on, never global. Knows no cameras and no bodies: `psfs`
and `apf` stand on it. What a user can mend raises `InputError`, `MissingFileError` or
`DeviceError`, all of them `UserError`.
"""

from cl.array import Array
from cl.device import Device, NumpyDevice, select_device
from cl.errors import DeviceError, InputError, MissingFileError, UserError
from cl.launch import Kernel, Launch, Step
from cl.listing import DeviceInfo, list_devices
from cl.probe import Probe
from cl.profile import Profile

__all__ = [
    "Array",
    "Device",
    "DeviceError",
    "DeviceInfo",
    "InputError",
    "Kernel",
    "Launch",
    "MissingFileError",
    "NumpyDevice",
    "Probe",
    "Profile",
    "Step",
    "UserError",
    "list_devices",
    "select_device",
]

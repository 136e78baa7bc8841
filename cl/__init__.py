"""OpenCL for this project: devices, programs, arrays, timings. Knows no cameras and no bodies."""

from cl.array import Array
from cl.device import Device, NumpyDevice, select_device
from cl.errors import DeviceError, InputError, MissingFileError, UserError
from cl.launch import Kernel, Launch
from cl.listing import DeviceInfo, list_devices
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
    "Profile",
    "UserError",
    "list_devices",
    "select_device",
]

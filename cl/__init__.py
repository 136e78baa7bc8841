"""Compute on OpenCL devices: choose one, build kernels, keep arrays there, time what runs.

    import cl

    device = cl.Device.best()  # or cl.select_device("cpu"), "numpy", part of a name
    array = device.to_device(values)

A `Device` is made by the caller and passed on, never global. Knows no cameras and no bodies: `psfs`
and `apf` stand on it. Errors that the user can fix are `InputError`, `MissingFileError` or
`DeviceError`, subclasses of `UserError`.
"""

import lazy_loader as _lazy

# The names are in __init__.pyi; each is imported when it is first asked for: errors and settings
# must not wait for OpenCL.
__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

"""Errors that a user can mend: a file, a setting, a device.

The message is one line that names what was found and what was expected.
"""


class UserError(Exception):
    """Something the user can mend; commands end with its line and exit code 2."""


class InputError(UserError, ValueError):
    """A file, a setting or an argument is not what it should be."""


class MissingFileError(InputError, FileNotFoundError):
    """A file or folder that should be there is not."""


class DeviceError(UserError, RuntimeError):
    """An OpenCL device is missing, or too small for what is asked of it."""

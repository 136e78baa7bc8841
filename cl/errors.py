"""Errors that a user can mend: a file, a setting, a device.

The message is one line that names what was found and what was expected.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyopencl


class UserError(Exception):
    """Something the user can mend; commands end with its line and exit code 2."""


class InputError(UserError, ValueError):
    """A file, a setting or an argument is not what it should be."""


class MissingFileError(InputError, FileNotFoundError):
    """A file or folder that should be there is not."""


class DeviceError(UserError, RuntimeError):
    """An OpenCL device is missing, or too small for what is asked of it."""


@contextmanager
def failing_as_device(device: str, what: str) -> Iterator[None]:
    """Turn the errors of OpenCL inside, of a device that was lost or whose memory does not suffice,
    into DeviceError that names the `device` and `what` it was doing."""
    import pyopencl  # takes a while to load

    try:
        yield
    except pyopencl.Error as error:
        raise device_failure(device, what, error) from error


def device_failure(device: str, what: str, error: pyopencl.Error) -> DeviceError:
    """Return OpenCL's `error` as `failing_as_device` raises it: where a context manager's 3 us are
    too many."""
    reason = " ".join(str(error).split())[:200]
    return DeviceError(
        f"{device}: {what} failed ({reason}); expected a device that stays and has the memory"
    )

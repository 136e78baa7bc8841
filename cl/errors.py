"""Errors that a user can fix: a file, a setting, a device.

The message is one line that names what was found and what was expected.
"""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyopencl


class UserError(Exception):
    """Error that the user can fix; a command prints its line and ends with exit code 2."""


class InputError(UserError, ValueError):
    """Error of an invalid file, setting or argument."""


class MissingFileError(InputError, FileNotFoundError):
    """Error of a file or folder that does not exist."""

    def __reduce__(self) -> tuple[type[MissingFileError], tuple[object, ...]]:
        # By tblib, by which Dask hands errors on, OSError's own cannot be read back.
        return type(self), self.args


class DeviceError(UserError, RuntimeError):
    """Error of an OpenCL device that is missing, broken or too small."""


def pip_command(extra: str) -> str:
    """Return the command that installs an `extra` of this package from where it was installed: a
    clone of the repository, or an index of packages."""
    clone = Path(__file__).parents[1]
    source = "psfs-apf"
    if (clone / "pyproject.toml").is_file():
        source = "." if clone == Path.cwd() else str(clone)
    else:
        from importlib import metadata  # takes 20 ms

        with contextlib.suppress(Exception):  # an installer that writes no such file
            text = metadata.distribution("psfs-apf").read_text("direct_url.json") or "{}"
            if url := json.loads(text).get("url"):
                source = url.removeprefix("file://") if url.startswith("file://") else f"git+{url}"
    if source.startswith("git+"):
        return f"pip install 'psfs-apf[{extra}] @ {source}'"
    return f"pip install '{source}[{extra}]'"


class raise_device_errors:
    """Convert OpenCL errors in the `with` block, such as a lost device or too little memory, to
    DeviceError that names the `device` and `what` it was doing.

    A class, since a generator's context manager takes 2 us, of which a frame has ten."""

    __slots__ = ("_device", "_what")

    def __init__(self, device: str, what: str) -> None:
        self._device, self._what = device, what

    def __enter__(self) -> None:
        pass

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is None:
            return
        import pyopencl  # takes a while to load

        if isinstance(error, pyopencl.Error):
            raise device_failure(self._device, self._what, error) from error


def device_failure(device: str, what: str, error: pyopencl.Error) -> DeviceError:
    """Return OpenCL's `error` as `raise_device_errors` raises it: where a context manager's 3 us
    are too many."""
    reason = " ".join(str(error).split())[:200]
    return DeviceError(
        f"{device}: {what} failed ({reason}); expected a device that stays and has the memory"
    )

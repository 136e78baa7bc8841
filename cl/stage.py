"""The base of what runs the kernels of one file."""

from __future__ import annotations

from collections.abc import Sequence

from cl.device import Device
from cl.launch import Kernel, Launch
from cl.program import Define
from cl.signature import Argument


class Stage:
    """The kernels of one file, built with the same defines and launched on one device.

    A subclass names the file, `cl/kernels/<kernels>.cl`, or "package:file" of another package,
    calls the constructor with the defines, allocates its buffers with `self.device` and makes its
    launches, whose arguments are set once, with `self.launch`. Programs are cached by the device.

    kernels: the file. defines: what it is built with.
    """

    kernels: str

    def __init__(self, device: Device, **defines: Define) -> None:
        self.device, self.defines = device, defines

    def kernel(self, name: str) -> Kernel:
        """Return a kernel of the file. Raises DeviceError if it has no such kernel."""
        return self.device.kernel(self.kernels, name, **self.defines)

    def launch(
        self,
        name: str,
        global_size: Sequence[int],
        local_size: Sequence[int] | None = None,
        /,
        **arguments: Argument,
    ) -> Launch:
        """Return a launch of the kernel `name`, see `Device.launch`."""
        return self.device.launch(self.kernel(name), global_size, local_size, **arguments)

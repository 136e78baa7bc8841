"""Choosing an OpenCL device and running kernels on it."""

from __future__ import annotations

import copy
import ctypes
import logging
import math
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import pyopencl

from cl.array import Array
from cl.errors import DeviceError, raise_device_errors
from cl.launch import Kernel, Launch
from cl.listing import (
    DeviceInfo,
    device_info,
    ranked_devices,
    where_to_get_opencl,
)
from cl.probe import probe
from cl.profile import Profile
from cl.program import Define, build_options, kernel_source, shared_programs
from cl.signature import Argument

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class NumpyDevice:
    """The NumPy twins as a device, so that `numpy` can be chosen like any other."""

    name: str = "numpy"


@dataclass
class Transfers:
    """Host transfers so far: numbers of copies and of bytes in each direction."""

    uploads: int = 0
    upload_bytes: int = 0
    downloads: int = 0
    download_bytes: int = 0


def select_device(choice: str = "auto", profile: bool = False) -> Device | NumpyDevice:
    """Return the device for `auto`, `gpu`, `cpu`, `gpu:N`, `cpu:N`, `numpy` or a NAME.

    `auto`, `gpu` and `cpu` take the first device that works, in the order of `list_devices`, and
    warn of those before it that do not. N counts those of a kind from 0. NAME is any part of a
    device's name or its platform's, in upper or lower case. Raises DeviceError if there is no such
    device, or if it does not work.
    """
    if choice == "numpy":
        return NumpyDevice()
    faults: list[str] = []
    for handle in _candidates(choice):
        fault = probe(handle).fault
        if fault is None:
            for line in faults:
                log.warning("%s; %s is used", line, handle.name.strip())
            return Device(handle, profile=profile)
        faults.append(f"{handle.name.strip()} does not work: {fault}")
    raise DeviceError(f"{'; '.join(faults)}; expected a driver that works, or another device")


def _candidates(choice: str) -> list[Any]:
    """Return the devices that `choice` may mean, the best first; at least one."""
    devices = ranked_devices()
    kind, _, number = choice.partition(":")
    if choice == "auto":
        found = devices
    elif kind in ("gpu", "cpu") and (number.isdecimal() or choice == kind):
        found = [d for d in devices if device_info(d).kind == kind]
        found = found[int(number) :][:1] if number else found
    else:
        wanted = choice.lower()
        found = [d for d in devices if wanted in f"{d.name} {d.platform.name}".lower()][:1]
    if found:
        return found
    if not devices:
        raise DeviceError(f"this machine has no OpenCL device: {where_to_get_opencl()}")
    names = ", ".join(device.name.strip() for device in devices)
    raise DeviceError(f"no OpenCL device matches {choice}; found: {names}")


@dataclass
class Device:
    """An OpenCL device with its queue and arrays; context and built programs are shared by all
    `Device`s of the same handle that there are.

    Made by the caller and passed on; never global. `Device.best()` is the fastest one found.
    handle: a device of pyopencl that works, see `cl.listing.working_devices`.
    """

    handle: Any
    profile: bool = False
    info: DeviceInfo = field(init=False)
    transfers: Transfers = field(init=False, default_factory=Transfers)
    profiler: Profile | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.info = device_info(self.handle)
        try:
            self.programs = shared_programs(self.handle)
            self.context = self.programs.context
            profiling: Any = pyopencl.command_queue_properties.PROFILING_ENABLE
            self.queue = pyopencl.CommandQueue(self.context, properties=profiling * self.profile)
        except pyopencl.Error as error:
            raise DeviceError(f"the device {self.name} cannot be used: {error}") from error
        self.profiler = Profile() if self.profile else None
        # Bytes; shared by siblings, as a list is. Threads change it without a lock: CPython
        # switches them at calls and jumps, of which `+=` on an item of a list has none.
        self._allocated = [0]

    @classmethod
    def best(cls, profile: bool = False) -> Device:
        """Return the OpenCL device that `auto` takes."""
        device = select_device("auto", profile)
        assert isinstance(device, Device)
        return device

    @property
    def queue(self) -> Any:
        """The queue that everything is enqueued on."""
        return self._queue

    @queue.setter
    def queue(self, queue: Any) -> None:
        self._queue = queue
        self.raw_queue = ctypes.c_void_p(queue.int_ptr)  # as `Launch` takes it

    def sibling(self) -> Device:
        """Return the same device, memory and programs with a queue of its own, for another thread.

        Queues do not wait for each other: `finish()` one before another uses what it wrote.
        """
        other = copy.copy(self)
        other.queue = self.new_queue()
        other.transfers = Transfers()
        return other

    def new_queue(self) -> Any:
        """Return a queue beside the device's own, for `enqueue_on`."""
        return pyopencl.CommandQueue(self.context, properties=self.queue.properties)

    def wait_for(self, queue: Any) -> None:
        """Make the device's own queue wait, from now on, for all that `queue` holds."""
        _make_wait(self.queue, queue)

    def make_wait(self, queue: Any) -> None:
        """Make `queue` wait, from now on, for all that the device's own queue holds."""
        _make_wait(queue, self.queue)

    @contextmanager
    def enqueue_on(self, queue: Any) -> Iterator[Any]:
        """Enqueue the commands of the `with` block on `queue`; yield the device's own queue.

        They wait for all commands that the own queue holds on entry. Later commands of the own
        queue do not wait for them."""
        own = self.queue
        self.make_wait(queue)
        self.queue = queue
        try:
            yield own
        finally:
            self.queue = own
            queue.flush()

    @property
    def name(self) -> str:
        """The driver's name of the device."""
        return self.info.name

    @property
    def is_gpu(self) -> bool:
        """Whether the device is a GPU."""
        return self.info.kind == "gpu"

    # Memory ---------------------------------------------------------------------------------

    def empty(
        self, shape: int | Sequence[int], dtype: npt.DTypeLike, what: str = "an array"
    ) -> Array:
        """Allocate an uninitialised array; `what` names it in the DeviceError that is raised where
        memory does not suffice."""
        shape = (shape,) if isinstance(shape, int) else tuple(int(n) for n in shape)
        nbytes = max(1, math.prod(shape) * np.dtype(dtype).itemsize)
        self.require_memory(nbytes, what)
        try:
            # Of whole words: kernels load those of an array of bytes.
            words = pyopencl.Buffer(
                self.context, pyopencl.mem_flags.READ_WRITE, -(-nbytes // 4) * 4
            )
        except pyopencl.Error as error:
            raise DeviceError(
                f"{self.name} could not allocate {_megabytes(nbytes)} for {what}: {error}"
            ) from error
        array = Array(self, words, shape, dtype)
        self._allocated[0] += nbytes
        weakref.finalize(array, self._release, nbytes)
        return array

    def zeros(
        self, shape: int | Sequence[int], dtype: npt.DTypeLike, what: str = "an array"
    ) -> Array:
        """Allocate an array of zeros, see `empty`."""
        array = self.empty(shape, dtype, what)
        array.fill(0)
        return array

    def fill(self, array: Array, value: float) -> None:
        """Set every element of `array` to `value`, on the device."""
        if not array.nbytes:
            return
        pattern = np.array(value, array.dtype)
        with raise_device_errors(self.name, "a fill"):
            event = pyopencl.enqueue_fill_buffer(
                self.queue, array.whole, pattern, array.start, array.nbytes
            )
        self.record("fill", event)

    def to_device(self, host: np.ndarray, what: str = "an array") -> Array:
        """Return a new array with the content of `host`, see `empty`."""
        host = np.ascontiguousarray(host)
        array = self.empty(host.shape, host.dtype, what)
        if host.size:
            array.set(host)
        return array

    def require_memory(self, nbytes: int, what: str) -> None:
        """Raise DeviceError unless `nbytes` more can be allocated, in one piece."""
        largest = self.handle.max_mem_alloc_size
        free = self.info.memory - self.allocated
        if nbytes > min(largest, free):
            raise DeviceError(
                f"{what} needs {_megabytes(nbytes)}, but {self.name} has "
                f"{_megabytes(max(free, 0))} left and allows {_megabytes(largest)} in one piece"
            )

    @property
    def allocated(self) -> int:
        """Bytes of all arrays that there are, siblings' included."""
        return self._allocated[0]

    def _release(self, nbytes: int) -> None:
        self._allocated[0] -= nbytes

    # Kernels --------------------------------------------------------------------------------

    def kernel(self, stage: str, name: str, **defines: Define) -> Kernel:
        """Return the kernel `name` of `cl/kernels/<stage>.cl`.

        The program is built once for each set of `defines` (passed as -D NAME=VALUE), for all
        `Device`s of the same handle that there are.
        Raises DeviceError if it has no such kernel.
        """
        return self.compile_kernel(kernel_source(stage), name, f"{stage}.cl", **defines)

    def compile_kernel(self, source: str, name: str, file: str, /, **defines: Define) -> Kernel:
        """Return the kernel `name` of a text; `file` names the text in errors.

        Raises DeviceError if the driver does not build it.
        """
        try:
            return self.programs.kernel(source, name, file, build_options(defines))
        except pyopencl.Error as error:
            log.info("%s", file, exc_info=True)
            reason = str(error).partition(">:")[2] or str(error)  # after the device's address
            raise DeviceError(
                f"{self.name} does not build {file} ({' '.join(reason.split())}); expected a "
                "driver that works, and room for its temporary files and its cache"
            ) from error

    def launch(
        self,
        kernel: Kernel,
        global_size: Sequence[int],
        local_size: Sequence[int] | None,
        /,
        **arguments: Argument,
    ) -> Launch:
        """Return a launch of `kernel` with its arguments set once; call it to enqueue it.

        Arguments go by their names in the kernel's prototype; see `Launch.set` for their kinds.
        The global size is padded to a multiple of the local size: kernels check their bounds. State
        a local size that does not depend on the data: PoCL compiles a kernel for every local size
        (.15 s each), and a GPU's driver looks for one in every launch (8 us on an H200).
        Raises TypeError for missing and unknown arguments.
        """
        return Launch(self, kernel, global_size, local_size, arguments)

    def record(self, name: str, event: Any, upload: int = 0, download: int = 0) -> None:
        """Count a transfer and keep the event if the device is profiled."""
        if upload:
            self.transfers.uploads += 1
            self.transfers.upload_bytes += upload
        if download:
            self.transfers.downloads += 1
            self.transfers.download_bytes += download
        if self.profiler is not None:
            self.profiler.add(name, event)

    def finish(self) -> None:
        """Wait for all that the device's own queue holds."""
        with raise_device_errors(self.name, "its work"):
            self.queue.finish()


def _make_wait(later: Any, first: Any) -> None:
    """Make the queue `later` wait, from now on, for all that `first` holds."""
    if later is not first:
        done = pyopencl.enqueue_marker(first)
        first.flush()
        pyopencl.enqueue_barrier(later, wait_for=[done])


def _megabytes(nbytes: int) -> str:
    return f"{nbytes / 2**20:,.0f} MiB"


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

"""Kernels and their launches, whose arguments are bound by name."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Any, TypeAlias

import pyopencl
import pyopencl._cl

from cl.array import Array, Commands
from cl.errors import DeviceError, device_failure
from cl.signature import Argument, Parameter, Signatures


def _load_enqueue(library: str) -> Callable[..., int] | None:
    """Return clEnqueueNDRangeKernel of the OpenCL loader that pyopencl is linked to; None if it
    cannot be reached through pyopencl (Windows)."""
    try:
        enqueue = ctypes.PyDLL(library).clEnqueueNDRangeKernel
    except (OSError, AttributeError):
        return None
    enqueue.restype = ctypes.c_int
    return enqueue


#: Calling OpenCL directly avoids pyopencl's event, which is not used: a launch then takes 5.6 us of
#: host time instead of 8.2 us (H200).
_ENQUEUE = _load_enqueue(pyopencl._cl.__file__)


class _CodeCache(dict[Any, Any]):
    """Keeps what pyopencl generates for each kernel in memory: it reads that from a database for
    every `Kernel`, of which a tracker makes a thousand (0.65 s)."""

    def store_if_not_present(self, key: Any, value: Any) -> None:
        self.setdefault(key, value)


@cache
def _keep_code() -> None:
    """Let pyopencl keep what it generates in memory. Its module opens the database when it is
    imported, for which the device has found a folder by then."""
    import pyopencl.invoker

    pyopencl.invoker.invoker_cache = _CodeCache()  # type: ignore[assignment]


#: Part of a frame's work, done when called: a `Launch`, or a computation by another library that
#: the host must wait for.
Step: TypeAlias = Callable[[], None]


class Kernel:
    """Kernel of a built program and its parameters; holds no arguments itself.

    parameters: by name, in the order of the prototype. Raises DeviceError if the program has no
    kernel of that name, or one with other parameters than were read from `file`.
    """

    def __init__(self, program: Any, name: str, file: str, signatures: Signatures) -> None:
        self.name, self.file = name, file
        if name not in signatures:
            found = ", ".join(signatures) or "none at all"
            raise DeviceError(f"{file} has no kernel {name}; found: {found}")
        self._program = program
        self.parameters = {parameter.name: parameter for parameter in signatures[name]}
        #: The places of the kernel's arguments by name.
        self.places = {
            argument: place
            for place, argument in enumerate(
                dict.fromkeys(parameter.argument for parameter in signatures[name])
            )
        }
        built = self.fresh().num_args
        if built != len(self.places):
            raise DeviceError(
                f"kernel {name} of {file}: {built} arguments were built, but "
                f"{len(self.places)} read from its prototype"
            )

    def fresh(self) -> Any:
        """Return a pyopencl kernel that keeps its own arguments. Raises DeviceError where the
        defines leave it out."""
        _keep_code()
        try:
            return pyopencl.Kernel(self._program, self.name)
        except pyopencl.LogicError as error:
            raise DeviceError(f"{self} was not built with these defines: {error}") from error

    def __str__(self) -> str:
        return f"kernel {self.name} of {self.file}"


class Launch:
    """Kernel whose arguments are set; a call enqueues it and, on a profiled device, records its
    event.

    name: label of its timings, by default the kernel's name. arguments: current values by name:
    arrays, numbers, None.
    """

    def __init__(
        self,
        device: Commands,
        kernel: Kernel,
        global_size: Sequence[int],
        local_size: Sequence[int] | None,
        arguments: Mapping[str, Argument],
    ) -> None:
        self.device = device
        self.name = kernel.name
        self.local_size = tuple(local_size) if local_size else None
        self.global_size = _pad(tuple(global_size), self.local_size)
        missing = [name for name in kernel.parameters if name not in arguments]
        if missing:
            raise TypeError(f"{kernel}: missing {', '.join(missing)}")
        self.kernel = kernel
        # Made and bound when it is first enqueued.
        self._bound: Any = None
        self._sizes: tuple[Any, ...] = ()
        self._unbound: dict[str, Any] = {}  # arguments that are not bound yet
        self._structs = _empty_structs(kernel.parameters.values())
        # Keeps arrays alive as long as the kernel refers to them.
        self.arguments: dict[str, Argument] = {}
        self.set(**arguments)

    def set(self, **arguments: Argument) -> None:
        """Change arguments, by their names in the kernel's prototype.

        Pointers take an `Array` of the kernel's own type of number, or None where the kernel does
        not use them, local ones a pyopencl.LocalMemory; vectors take as many numbers as they have;
        all numbers are converted to the kernel's own type. Raises TypeError for a name that the
        kernel does not know or a value of the wrong kind, ValueError for an integer out of range.
        """
        for name, value in arguments.items():
            parameter = self.kernel.parameters.get(name)
            if parameter is None:
                known = ", ".join(self.kernel.parameters)
                raise TypeError(f"{self.kernel}: no argument {name}; expected {known}")
            try:
                converted = parameter.convert(value)
            except (TypeError, ValueError) as error:
                raise type(error)(f"{self.kernel}, argument {name}: {error}") from None
            self.arguments[name] = value
            if parameter.struct:
                struct, start = self._structs[parameter.struct], parameter.offset
                number = converted.tobytes()
                struct[start : start + len(number)] = number
                self._unbound[parameter.struct] = struct
            else:
                self._unbound[name] = converted

    def __call__(self) -> None:
        device, profiler = self.device, self.device.profiler
        if self._unbound or self._bound is None:
            self._bind()
        raw = _ENQUEUE if profiler is None else None
        if raw is not None and raw(device.raw_queue, *self._sizes) == 0:
            return
        # If that fails, enqueue through pyopencl, which raises descriptive errors.
        try:
            event = pyopencl.enqueue_nd_range_kernel(
                device.queue, self._bound, self.global_size, self.local_size
            )
        except pyopencl.Error as error:
            raise device_failure(device.name, f"kernel {self.name}", error) from error
        if profiler is not None:
            profiler.add(self.name, event)

    def _bind(self) -> None:
        if self._bound is None:
            self._bound = self.kernel.fresh()
            self._sizes = _raw_sizes(self._bound, self.global_size, self.local_size)
        for name, value in self._unbound.items():
            bound = value.buffer if isinstance(value, Array) else value
            self._bound.set_arg(self.kernel.places[name], bound)
        self._unbound.clear()


def _empty_structs(parameters: Iterable[Parameter]) -> dict[str, bytearray]:
    """Return room for each struct among a kernel's arguments, by name: its size is a multiple of
    that of its largest field."""
    ends: dict[str, tuple[int, int]] = {}
    for parameter in parameters:
        if parameter.struct and parameter.dtype is not None:
            size = parameter.dtype.itemsize * (4 if parameter.width == 3 else parameter.width)
            largest = max(size, ends.get(parameter.struct, (0, 0))[1])
            ends[parameter.struct] = parameter.offset + size, largest
    return {name: bytearray(-(-end // largest) * largest) for name, (end, largest) in ends.items()}


def _raw_sizes(
    kernel: Any, global_size: tuple[int, ...], local_size: tuple[int, ...] | None
) -> tuple[Any, ...]:
    """Return the arguments of clEnqueueNDRangeKernel after the queue: no offset, no events."""
    sizes = ctypes.c_size_t * len(global_size)
    shape = sizes(*global_size), sizes(*local_size) if local_size else None
    return ctypes.c_void_p(kernel.int_ptr), len(global_size), None, *shape, 0, None, None


def _pad(global_size: tuple[int, ...], local_size: tuple[int, ...] | None) -> tuple[int, ...]:
    if local_size is None:
        return global_size
    return tuple(-(-g // n) * n for g, n in zip(global_size, local_size, strict=True))

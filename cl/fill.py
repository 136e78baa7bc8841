"""Fill arrays: by OpenCL's command, or by a kernel on CPUs, where the command uses one core."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol
from weakref import WeakKeyDictionary

import numpy as np
import pyopencl

from cl.array import Array, Commands
from cl.errors import raise_device_errors
from cl.launch import Kernel, Launch

#: Least bytes and cores for a fill by kernel: two cores are no faster than OpenCL's command.
_LARGE, _MANY = 1_000_000, 4
#: Bytes of a pack of fill.cl, and packs of a work-group.
_PACK_BYTES, _FILL_GROUP = 16, 1024


@dataclass(frozen=True)
class Fill:
    """A fill of an array, done when called."""

    array: Array
    value: float

    def __call__(self) -> None:
        self.array.fill(self.value)


class Builder(Commands, Protocol):
    """The part of a `Device` that fills use."""

    @property
    def cpu_cores(self) -> int: ...

    def kernel(self, stage: str, name: str) -> Kernel: ...


class Fills:
    """Fills arrays of a device, and keeps the launches that do so as long as their arrays live."""

    def __init__(self) -> None:
        self._launches: WeakKeyDictionary[Array, Launch] = WeakKeyDictionary()

    def fill(self, device: Builder, array: Array, value: float) -> None:
        """Set every element of `array` to `value`, on the device."""
        pattern = np.array(value, array.dtype)
        large = array.nbytes >= _LARGE and array.dtype.itemsize <= 4
        done = 0
        if large and device.cpu_cores >= _MANY:
            done = self._fill_by_kernel(device, array, pattern)
        if done == array.nbytes:
            return
        with raise_device_errors(device.name, "a fill"):
            event = pyopencl.enqueue_fill_buffer(
                device.queue, array.whole, pattern, array.start + done, array.nbytes - done
            )
        device.record("fill", event)

    def _fill_by_kernel(self, device: Builder, array: Array, pattern: np.ndarray) -> int:
        """Enqueue the fill by all cores of a CPU; return how many bytes, a multiple of 16."""
        n = array.nbytes // _PACK_BYTES
        word = np.tile(pattern, 4 // array.dtype.itemsize).view(np.uint32)[0]
        if array not in self._launches:
            # Not `array`, which the launch would keep alive.
            words = Array(device, array.whole, (4 * n,), np.uint32, array.start)
            arguments = {"n": n, "word": word, "words": words}
            kernel = device.kernel("common/fill", "fill_words")
            launch = Launch(device, kernel, (n,), (_FILL_GROUP,), arguments)
            launch.name = "fill"
            self._launches[array] = launch
        launch = self._launches[array]
        launch.set(word=word)
        launch()
        return n * _PACK_BYTES

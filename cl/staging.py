"""Copies beside the device's work, and what is made of the next frame in the meantime."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pyopencl

from cl import Array, Device
from cl.array import Commands
from cl.errors import failing_as_device


class Uploads:
    """Copies host arrays into `target` on a queue of its own: `start(host)`, later `finish()`.

    Two buffers alternate, so that an upload need not wait until the one before it is used. An
    upload from `pinned` memory leaves the host free.
    """

    def __init__(self, device: Device, target: Array) -> None:
        self._device, self._target = device, target
        profiling: Any = pyopencl.command_queue_properties.PROFILING_ENABLE
        self._queue = pyopencl.CommandQueue(device.context, properties=profiling * device.profile)
        what = "the frames uploaded ahead"
        self._buffers = [device.empty(target.shape, target.dtype, what) for _ in range(2)]
        self._taken: list[Any] = [None, None]
        self._next = 0
        self._uploaded: Any = None

    def start(self, host: np.ndarray) -> None:
        """Enqueue the upload; `host` must not change until it is done. Raises ValueError unless it
        has the target's shape and type."""
        host = np.ascontiguousarray(host)
        if host.shape != self._target.shape or host.dtype != self._target.dtype:
            raise ValueError(
                f"expected {self._target.shape} {self._target.dtype}, got {host.shape} {host.dtype}"
            )
        before = self._taken[self._next]
        self._uploaded = pyopencl.enqueue_copy(
            self._queue,
            self._buffers[self._next].buffer,
            host,
            is_blocking=False,
            wait_for=[before] if before is not None else None,
        )
        self._device.record("upload", self._uploaded, upload=self._target.nbytes)
        self._queue.flush()

    def finish(self) -> None:
        """Enqueue, on the device's own queue, the copy of the upload into the target."""
        self._taken[self._next] = pyopencl.enqueue_copy(
            self._device.queue,
            self._target.buffer,
            self._buffers[self._next].buffer,
            byte_count=self._target.nbytes,
            wait_for=[self._uploaded],
        )
        self._device.record("copy", self._taken[self._next])
        self._next = 1 - self._next


class Download:
    """Copies of `source` to the host: `fetch()` enqueues one into page-locked memory, what it
    returns waits for it and gives it. Two host arrays alternate: the next but one overwrites it."""

    def __init__(self, source: Array) -> None:
        self._source = source
        self._hosts = [pinned(source.device, source.shape, source.dtype) for _ in range(2)]
        self._next = 0

    def fetch(self) -> Callable[[], np.ndarray]:
        source, device, host = self._source, self._source.device, self._hosts[self._next]
        self._next = 1 - self._next
        with failing_as_device(device.name, "a download"):
            event = pyopencl.enqueue_copy(device.queue, host, source.buffer, is_blocking=False)
        device.record("download", event, download=host.nbytes)

        def fetched() -> np.ndarray:
            with failing_as_device(device.name, "a download"):
                event.wait()
            return host

        return fetched


class Upload:
    """Copies of page-locked memory to `target`, as much of it as changed: fill the array that
    `room()` gives, then `start(n)` enqueues the copy of its first `n` numbers.

    Two host arrays alternate, so that the host waits for the upload before the last at most.
    """

    def __init__(self, target: Array) -> None:
        self._target, self._next = target, 0
        self._hosts = [pinned(target.device, (target.size,), target.dtype) for _ in range(2)]
        self._done: list[Any] = [None, None]

    def room(self) -> np.ndarray:
        """Return a flat host array like the target, of what an earlier upload left in it."""
        done = self._done[self._next]
        if done is not None:
            with failing_as_device(self._target.device.name, "an upload"):
                done.wait()
        return self._hosts[self._next]

    def start(self, n: int) -> None:
        """Enqueue the copy of the first `n` numbers of what `room` gave last."""
        device, host = self._target.device, self._hosts[self._next][:n]
        with failing_as_device(device.name, "an upload"):
            event = pyopencl.enqueue_copy(
                device.queue, self._target.buffer, host, is_blocking=False
            )
        device.record("upload", event, upload=host.nbytes)
        self._done[self._next] = event
        self._next = 1 - self._next


class Ahead:
    """Arrays of so many `shapes` and types that are `written`, zero before, for the next frame
    while those of this one are still `read`. `show()` makes what is written what is read.

    On a GPU both lie in one piece of memory each, so that showing is one copy (17 MB: 12 us); on a
    CPU, which does one thing at a time, they are the same arrays.
    """

    def __init__(
        self, device: Device, shapes: Sequence[tuple[tuple[int, ...], npt.DTypeLike]], what: str
    ) -> None:
        self._device = device
        if not device.is_gpu:
            self.read = self.written = [device.zeros(*each, what) for each in shapes]
            return
        align = max(1, device.handle.mem_base_addr_align // 8)
        sizes = [math.prod(shape) * np.dtype(dtype).itemsize for shape, dtype in shapes]
        places = np.cumsum([0, *(-(-max(1, size) // align) * align for size in sizes)])
        self._whole = [device.zeros((int(places[-1]),), np.uint8, what) for _ in range(2)]
        self.written, self.read = (
            [
                Array(device, whole.buffer.get_sub_region(int(place), max(1, size)), *each)
                for place, size, each in zip(places[:-1], sizes, shapes, strict=True)
            ]
            for whole in self._whole
        )

    def show(self) -> None:
        """Enqueue the copy of what is written; what reads it waits before and goes on behind."""
        if self.read is self.written:
            return
        source, target = self._whole
        with failing_as_device(self._device.name, "a copy"):
            event = pyopencl.enqueue_copy(
                self._device.queue, target.buffer, source.buffer, byte_count=source.nbytes
            )
        self._device.record("copy", event)


def pinned(device: Commands, shape: tuple[int, ...], dtype: npt.DTypeLike = np.uint8) -> np.ndarray:
    """Return a host array in memory that the device reads at full speed: page-locked, if it has
    such."""
    nbytes = int(np.prod(shape)) * np.dtype(dtype).itemsize
    flags = pyopencl.mem_flags.READ_WRITE | pyopencl.mem_flags.ALLOC_HOST_PTR
    buffer = pyopencl.Buffer(device.context, flags, nbytes)
    mapping: Any = pyopencl.map_flags.READ | pyopencl.map_flags.WRITE
    array, _ = pyopencl.enqueue_map_buffer(device.queue, buffer, mapping, 0, shape, np.dtype(dtype))
    return array

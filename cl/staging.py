"""Copies that overlap with the device's work, and arrays for the next frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyopencl

from cl import Array, Device
from cl.array import Commands
from cl.errors import raise_device_errors


class Uploads:
    """Copies host arrays into `target` on a queue of its own: `start(host)`, later `finish()`.

    Two buffers alternate, so that an upload need not wait until the one before it is used. An
    upload from `allocate_pinned` memory leaves the host free.
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
        with raise_device_errors(self._device.name, "an upload"):
            self._uploaded = pyopencl.enqueue_copy(
                self._queue,
                self._buffers[self._next].whole,
                host,
                is_blocking=False,
                wait_for=[before] if before is not None else None,
            )
            self._queue.flush()
        self._device.record("upload", self._uploaded, upload=self._target.nbytes)

    def finish(self) -> None:
        """Enqueue, on the device's own queue, the copy of the upload into the target."""
        with raise_device_errors(self._device.name, "a copy"):
            self._taken[self._next] = pyopencl.enqueue_copy(
                self._device.queue,
                self._target.whole,
                self._buffers[self._next].whole,
                byte_count=self._target.nbytes,
                dst_offset=self._target.start,
                wait_for=[self._uploaded],
            )
        self._device.record("copy", self._taken[self._next])
        self._next = 1 - self._next


class Download:
    """Copier of `source` to the host: `fetch()` enqueues a copy into page-locked memory and returns
    a function that waits for the copy and returns it. Two host arrays alternate: the second fetch
    after a copy overwrites it."""

    def __init__(self, source: Array) -> None:
        self._source = source
        self._hosts = [allocate_pinned(source.device, source.shape, source.dtype) for _ in range(2)]
        self._next = 0

    def fetch(self) -> Callable[[], np.ndarray]:
        source, device, host = self._source, self._source.device, self._hosts[self._next]
        self._next = 1 - self._next
        with raise_device_errors(device.name, "a download"):
            event = pyopencl.enqueue_copy(
                device.queue, host, source.whole, src_offset=source.start, is_blocking=False
            )
        device.record("download", event, download=host.nbytes)

        def fetched() -> np.ndarray:
            with raise_device_errors(device.name, "a download"):
                event.wait()
            return host

        return fetched


class Upload:
    """Copier of page-locked memory to the start of `target`: fill the array that `room()` returns,
    then `start(n)` enqueues the copy of its first `n` numbers.

    Two host arrays alternate, so that the host waits at most for the upload before the last.
    """

    def __init__(self, target: Array) -> None:
        self._target, self._next = target, 0
        self._hosts = [
            allocate_pinned(target.device, (target.size,), target.dtype) for _ in range(2)
        ]
        self._done: list[Any] = [None, None]

    def room(self) -> np.ndarray:
        """Return a flat host array like the target, of what an earlier upload left in it."""
        done = self._done[self._next]
        if done is not None:
            with raise_device_errors(self._target.device.name, "an upload"):
                done.wait()
        return self._hosts[self._next]

    def start(self, n: int) -> None:
        """Enqueue the copy of the first `n` numbers of what `room` gave last."""
        device, host = self._target.device, self._hosts[self._next][:n]
        with raise_device_errors(device.name, "an upload"):
            event = pyopencl.enqueue_copy(
                device.queue,
                self._target.whole,
                host,
                dst_offset=self._target.start,
                is_blocking=False,
            )
        device.record("upload", event, upload=host.nbytes)
        self._done[self._next] = event
        self._next = 1 - self._next


@dataclass(frozen=True)
class Copy:
    """A copy on the device of an array to another of the same size, done when called."""

    source: Array
    target: Array

    def __call__(self) -> None:
        source, target, device = self.source, self.target, self.source.device
        with raise_device_errors(device.name, "a copy"):
            event = pyopencl.enqueue_copy(
                device.queue, target.whole, source.whole, byte_count=source.nbytes,
                src_offset=source.start, dst_offset=target.start,
            )  # fmt: skip
        device.record("copy", event)


class Ahead:
    """Double buffer: the arrays `written` for the next frame, and the arrays `read` by the search
    of the current one, both of `shapes` and types and zero at first. `show()` copies the former to
    the latter.

    On a GPU each set of arrays is one block of memory, so that `show` is one copy (17 MB: 12 us).
    On a CPU, which does one thing at a time, both are the same arrays.
    """

    def __init__(
        self, device: Device, shapes: Sequence[tuple[tuple[int, ...], npt.DTypeLike]], what: str
    ) -> None:
        if not device.is_gpu:
            self.read = self.written = [device.zeros(*each, what) for each in shapes]
            return
        align = max(1, device.handle.mem_base_addr_align // 8)
        sizes = [math.prod(shape) * np.dtype(dtype).itemsize for shape, dtype in shapes]
        places = np.cumsum([0, *(-(-max(1, size) // align) * align for size in sizes)])
        whole = [device.zeros((int(places[-1]),), np.uint8, what) for _ in range(2)]
        self._copy = Copy(*whole)
        self.written, self.read = (
            [
                part.region(int(place), *each)
                for place, each in zip(places[:-1], shapes, strict=True)
            ]
            for part in whole
        )

    def show(self) -> None:
        """Enqueue the copy from `written` to `read`, in order with other commands of the queue."""
        if self.read is self.written:
            return
        self._copy()


def allocate_pinned(
    device: Commands, shape: tuple[int, ...], dtype: npt.DTypeLike = np.uint8
) -> np.ndarray:
    """Return a host array in memory that the device reads at full speed: page-locked, if it has
    such."""
    nbytes = int(np.prod(shape)) * np.dtype(dtype).itemsize
    flags = pyopencl.mem_flags.READ_WRITE | pyopencl.mem_flags.ALLOC_HOST_PTR
    mapping: Any = pyopencl.map_flags.READ | pyopencl.map_flags.WRITE
    with raise_device_errors(device.name, f"{nbytes:,} bytes of page-locked memory"):
        buffer = pyopencl.Buffer(device.context, flags, nbytes)
        array, _ = pyopencl.enqueue_map_buffer(
            device.queue, buffer, mapping, 0, shape, np.dtype(dtype)
        )
    return array

"""Uploads of the next frame while the device works on this one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyopencl

from cl import Array, Device


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


def pinned(device: Device, shape: tuple[int, ...], dtype: Any = np.uint8) -> np.ndarray:
    """Return a host array in memory that the device reads at full speed: page-locked, if it has
    such."""
    nbytes = int(np.prod(shape)) * np.dtype(dtype).itemsize
    flags = pyopencl.mem_flags.READ_WRITE | pyopencl.mem_flags.ALLOC_HOST_PTR
    buffer = pyopencl.Buffer(device.context, flags, nbytes)
    mapping: Any = pyopencl.map_flags.READ | pyopencl.map_flags.WRITE
    array, _ = pyopencl.enqueue_map_buffer(device.queue, buffer, mapping, 0, shape, dtype)
    return array

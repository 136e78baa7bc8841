"""An n-dimensional array that lives on an OpenCL device."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import pyopencl

from cl.errors import raise_device_errors
from cl.profile import Profile


class Commands(Protocol):
    """The part of a `Device` that its arrays and launches use."""

    profiler: Profile | None

    @property
    def name(self) -> str: ...
    @property
    def queue(self) -> Any: ...
    @property
    def raw_queue(self) -> ctypes.c_void_p: ...
    @property
    def context(self) -> Any: ...

    def record(self, name: str, event: Any, upload: int = 0, download: int = 0) -> None:
        """Count a transfer and keep the event if the device is profiled."""

    def fill(self, array: Array, value: float) -> None:
        """Enqueue the filling of an array."""


class Array:
    """A C-ordered array in device memory: a part of a buffer that knows its shape and type.

    whole: the buffer that it lies in, from byte `start` on. `set` and `get` are the doors between
    host and device, beside those of `staging`; all are counted in `device.transfers`.
    """

    def __init__(
        self,
        device: Commands,
        whole: Any,
        shape: tuple[int, ...],
        dtype: npt.DTypeLike,
        start: int = 0,
    ) -> None:
        self.device = device
        self._buffer = None if start else whole  # released before `whole`, as it is named before it
        self.whole, self.start = whole, start
        self.shape = shape
        self.dtype = np.dtype(dtype)

    @property
    def buffer(self) -> Any:
        """The buffer that a kernel takes: of an array within another buffer a sub-buffer, which is
        made when it is first asked for."""
        if self._buffer is None:
            self._buffer = self.whole.get_sub_region(self.start, max(1, self.nbytes))
        return self._buffer

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)

    @property
    def nbytes(self) -> int:
        """Size of the elements, bytes."""
        return self.size * self.dtype.itemsize

    def view(self, dtype: npt.DTypeLike) -> Array:
        """Return the same memory, flat, as numbers of another type."""
        dtype = np.dtype(dtype)
        shape = (self.nbytes // dtype.itemsize,)
        return Array(self.device, self.whole, shape, dtype, self.start)

    def region(self, start: int, shape: Sequence[int], dtype: npt.DTypeLike) -> Array:
        """Return an array of the memory from byte `start` on, a multiple of the device's
        alignment."""
        return Array(self.device, self.whole, tuple(shape), dtype, self.start + start)

    def set(self, host: np.ndarray) -> None:
        """Copy `host` (same number of elements and type) to the device, without waiting."""
        host = np.ascontiguousarray(host)
        if host.dtype != self.dtype or host.size != self.size:
            raise ValueError(f"expected {self.shape} {self.dtype}, got {host.shape} {host.dtype}")
        with raise_device_errors(self.device.name, "an upload"):
            event = pyopencl.enqueue_copy(
                self.device.queue, self.whole, host, dst_offset=self.start, is_blocking=False
            )
        # The event keeps `host` alive until the copy is done.
        self.device.record("upload", event, upload=self.nbytes)

    def get(self, count: int | None = None) -> np.ndarray:
        """Copy to the host and wait; with `count`, only the first `count` rows (axis 0)."""
        shape = self.shape if count is None else (count, *self.shape[1:])
        host = np.empty(shape, self.dtype)
        if host.size:
            with raise_device_errors(self.device.name, "a download"):
                event = pyopencl.enqueue_copy(
                    self.device.queue, host, self.whole, src_offset=self.start
                )
            self.device.record("download", event, download=host.nbytes)
        return host

    def fill(self, value: float) -> None:
        """Set every element to `value`, on the device."""
        self.device.fill(self, value)


def get_together(arrays: Sequence[Array]) -> list[np.ndarray]:
    """Copy arrays of one device to the host, and wait once: each wait may take milliseconds where
    other threads hold Python's lock."""
    hosts = [np.empty(array.shape, array.dtype) for array in arrays]
    device, event = arrays[0].device, None
    with raise_device_errors(device.name, "a download"):
        for array, host in zip(arrays, hosts, strict=True):
            if host.size:
                event = pyopencl.enqueue_copy(
                    device.queue, host, array.whole, src_offset=array.start, is_blocking=False
                )
                device.record("download", event, download=host.nbytes)
        if event is not None:
            event.wait()
    return hosts

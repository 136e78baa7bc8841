"""An n-dimensional array that lives on an OpenCL device."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pyopencl

from cl.errors import failing_as_device

if TYPE_CHECKING:
    from cl.device import Device

#: Bytes, and cores, from which on all cores of a CPU fill: two are no faster than the command.
_LARGE, _MANY = 1_000_000, 4
#: Bytes of a pack of fill.cl, and packs of a work-group.
_PACK_BYTES, _FILL_GROUP = 16, 1024


class Array:
    """A C-ordered array in device memory: a buffer that knows its shape and type.

    `set` and `get` are the doors between host and device, beside those of `staging`; all are
    counted in `device.transfers`.
    """

    def __init__(self, device: Device, buffer: Any, shape: tuple[int, ...], dtype: Any) -> None:
        self.device = device
        self.buffer = buffer
        self.shape = shape
        self.dtype = np.dtype(dtype)
        self._filler: Any = None  # the launch that fills it, once there was one

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    @property
    def nbytes(self) -> int:
        return self.size * self.dtype.itemsize

    def view(self, dtype: Any) -> Array:
        """Return the same memory, flat, as numbers of another type."""
        dtype = np.dtype(dtype)
        return Array(self.device, self.buffer, (self.nbytes // dtype.itemsize,), dtype)

    def set(self, host: np.ndarray) -> None:
        """Copy `host` (same number of elements and type) to the device, without waiting."""
        host = np.ascontiguousarray(host)
        if host.dtype != self.dtype or host.size != self.size:
            raise ValueError(f"expected {self.shape} {self.dtype}, got {host.shape} {host.dtype}")
        with failing_as_device(self.device.name, "an upload"):
            event = pyopencl.enqueue_copy(self.device.queue, self.buffer, host, is_blocking=False)
        # The event keeps `host` alive until the copy is done.
        self.device.record("upload", event, upload=self.nbytes)

    def get(self, count: int | None = None) -> np.ndarray:
        """Copy to the host and wait; with `count`, only the first `count` rows (axis 0)."""
        shape = self.shape if count is None else (count, *self.shape[1:])
        host = np.empty(shape, self.dtype)
        if host.size:
            with failing_as_device(self.device.name, "a download"):
                event = pyopencl.enqueue_copy(self.device.queue, host, self.buffer)
            self.device.record("download", event, download=host.nbytes)
        return host

    def fill(self, value: float) -> None:
        """Set every element to `value`, on the device."""
        pattern = np.array(value, self.dtype)
        large = self.nbytes >= _LARGE and self.dtype.itemsize <= 4
        cores = 0 if self.device.is_gpu else self.device.info.compute_units
        done = self._fill_by_kernel(pattern) if large and cores >= _MANY else 0
        if done == self.nbytes:
            return
        with failing_as_device(self.device.name, "a fill"):
            event = pyopencl.enqueue_fill_buffer(
                self.device.queue, self.buffer, pattern, done, self.nbytes - done
            )
        self.device.record("fill", event)

    def _fill_by_kernel(self, pattern: np.ndarray) -> int:
        """Enqueue the fill by all cores of a CPU; return how many bytes, a multiple of 16."""
        n = self.nbytes // _PACK_BYTES
        word = np.tile(pattern, 4 // self.dtype.itemsize).view(np.uint32)[0]
        if self._filler is None:
            kernel = self.device.kernel("common/fill", "fill_words")
            # Not `self`, which would keep itself alive.
            words = Array(self.device, self.buffer, (4 * n,), np.dtype(np.uint32))
            self._filler = self.device.launch(
                kernel, (n,), (_FILL_GROUP,), n=n, word=word, words=words
            )
            self._filler.name = "fill"
        self._filler.set(word=word)
        self._filler()
        return n * _PACK_BYTES

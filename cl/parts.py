"""Arrays of one shape that lie one after the other in a single array."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cl.device import Device


class Parts:
    """An array `whole`, flat, and `n` arrays of a shape and type that lie in it, `step` elements
    apart, as the device's alignment asks for."""

    def __init__(self, device: Device, n: int, shape: Sequence[int], dtype: npt.DTypeLike) -> None:
        dtype = np.dtype(dtype)
        align = max(dtype.itemsize, device.handle.mem_base_addr_align // 8)
        nbytes = math.prod(shape) * dtype.itemsize
        apart = -(-nbytes // align) * align
        self.step = apart // dtype.itemsize
        self.whole = device.zeros((n * self.step,), dtype, "the parts of several people")
        self.arrays = [self.whole.region(k * apart, shape, dtype) for k in range(n)]

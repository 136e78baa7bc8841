"""Work-group shapes."""

from __future__ import annotations

from cl import Device

#: Largest work-group along a row on CPUs.
_LONGEST = 1024


def row_group(device: Device, n: int) -> tuple[int, int, int]:
    """Work-group for kernels whose work item 0 runs along rows of `n` elements in memory.

    A CPU gets the whole row, or equal parts of a long one: PoCL turns a work-group into one
    loop, which becomes vector code. A GPU gets small tiles.
    """
    if device.is_gpu:
        return (32, 4, 1)
    parts = -(-n // _LONGEST)
    return (-(-n // parts), 1, 1)

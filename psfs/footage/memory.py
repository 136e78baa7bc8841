"""How much memory the machine has, and what of it decoded frames may take."""

from __future__ import annotations

import os
import sys

#: For the frames of a sequence, at most; and the share of what a core has of the machine's.
_MOST, _SHARE = 2**30, 0.25


def physical_memory() -> int:
    """Return the bytes of this machine's memory; a very large number where nobody knows."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return sys.maxsize


def room_for_frames() -> float:
    """Return the bytes that the frames of a sequence may be kept in: with a process on each core
    they take a quarter of the machine's memory."""
    return min(_MOST, _SHARE * physical_memory() / (os.cpu_count() or 1))

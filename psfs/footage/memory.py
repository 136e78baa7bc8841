"""Memory for decoded frames, and how much of the machine's it may take."""

from __future__ import annotations

import math
import os
import weakref
from collections import deque

import numpy as np

from psfs.common.system import physical_memory

#: Most bytes for the frames of a sequence, and their share of the machine's memory per core.
_MAX_BYTES, _SHARE = 2**30, 0.25


def frame_memory_limit() -> float:
    """Return how many bytes the frames of a sequence may take.

    With one process per core, all frames together then take a quarter of the machine's memory.
    """
    return min(_MAX_BYTES, _SHARE * physical_memory() / (os.cpu_count() or 1))


class FrameMemory:
    """A reusable buffer for the frames of one sequence after another.

    When an array and its views are no longer used, its memory is kept for the next array if `keep`
    is set. New memory is costly: the system clears it page by page, 885 MB in 0.1 to 1 s of a core.
    """

    def __init__(self) -> None:
        self.keep = False
        self._free = deque[np.ndarray](maxlen=1)  # threads take from it; pop is atomic

    def array(self, shape: tuple[int, ...]) -> np.ndarray:
        """Return an uninitialised array of `shape`, uint8."""
        nbytes = math.prod(shape)
        try:
            piece = self._free.pop()
        except IndexError:
            piece = np.empty(0, np.uint8)
        if piece.nbytes < nbytes:
            piece = np.empty(nbytes, np.uint8)  # one allocation, so that it gets large pages
        # Views refer to `whole`; views of an array that owns its memory would refer to `piece`.
        whole = np.frombuffer(piece.data, np.uint8, nbytes)
        weakref.finalize(whole, self._keep_piece, piece).atexit = False
        return whole.reshape(shape)

    def _keep_piece(self, piece: np.ndarray) -> None:
        if self.keep:
            self._free.append(piece)


#: The one of this process.
FRAME_MEMORY = FrameMemory()

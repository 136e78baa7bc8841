"""How much memory the machine has, and what of it decoded frames may take."""

from __future__ import annotations

import math
import os
import weakref
from collections import deque

import numpy as np

from psfs.common.system import physical_memory

#: For the frames of a sequence, at most; and the share of what a core has of the machine's.
_MOST, _SHARE = 2**30, 0.25


def room_for_frames() -> float:
    """Return the bytes that the frames of a sequence may be kept in: with a process on each core
    they take a quarter of the machine's memory."""
    return min(_MOST, _SHARE * physical_memory() / (os.cpu_count() or 1))


class FrameMemory:
    """Memory for the frames of one sequence after another.

    `array(shape)` gives one; when it and its views are gone its memory is kept for the next, if
    `keep` says so: the system clears what is new page by page, 885 MB in 0.1 to 1 s of a core.
    """

    def __init__(self) -> None:
        self.keep = False
        self._free = deque[np.ndarray](maxlen=1)  # which threads take from, one of them a piece

    def array(self, shape: tuple[int, ...]) -> np.ndarray:
        """Return an array of `shape`, uint8, whatever is in it."""
        nbytes = math.prod(shape)
        try:
            piece = self._free.pop()
        except IndexError:
            piece = np.empty(0, np.uint8)
        if piece.nbytes < nbytes:
            piece = np.empty(nbytes, np.uint8)  # which gets large pages in one piece
        # Views of it refer to `whole`, not, as those of an array's own views, to `piece`.
        whole = np.frombuffer(piece.data, np.uint8, nbytes)
        weakref.finalize(whole, self._left, piece).atexit = False
        return whole.reshape(shape)

    def _left(self, piece: np.ndarray) -> None:
        if self.keep:
            self._free.append(piece)


#: That of this process.
FRAME_MEMORY = FrameMemory()

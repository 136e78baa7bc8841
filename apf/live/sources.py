"""Sources of live frames: what all have in common, a recording at its own rate, small pictures."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from apf.backend import FrameSource
from apf.live.timeline import Span, Timeline
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.diagnostics.small_views import Shrink
from psfs.sequence import Frame
from psfs.sequence import Sequence as Recording
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.occupied_box import finest_pixel

#: The stage that sources perform.
ACQUISITION = "acquisition"


@dataclass(frozen=True, eq=False)
class Shot:
    """A frame and the time at which it appeared, s of the timeline's clock."""

    frame: Frame
    time: float


T = TypeVar("T")


class Newest(Generic[T]):
    """Passes the newest item from one thread to another; older ones are dropped."""

    def __init__(self, dropped: Callable[[T], None]) -> None:
        self._condition = threading.Condition()
        self._item: T | None = None
        self._closed = False
        self._dropped = dropped

    def put(self, item: T) -> None:
        """Replace the item that waits, if there is one, by a newer one."""
        with self._condition:
            if self._item is not None:
                self._dropped(self._item)
            self._item = item
            self._condition.notify_all()

    def take(self) -> T | None:
        """Wait for the newest item and return it; None after the last one."""
        with self._condition:
            self._condition.wait_for(lambda: self._item is not None or self._closed)
            item, self._item = self._item, None
            return item

    def close(self) -> None:
        """Declare that no further item will come; the last one can still be taken."""
        with self._condition:
            self._closed = True
            self._condition.notify_all()


class Source(FrameSource, Protocol):
    """The input of live tracking. fps: frames per second. changed: why it goes on with other
    cameras; empty as long as it does not."""

    fps: float
    changed: str

    def first(self) -> Frame:
        """Return a frame for the preparation."""

    def run(self, shots: Newest[Shot], timeline: Timeline, stop: threading.Event) -> None:
        """Put shots until the end, `stop`, or until a camera is gone or comes back. Raises
        InputError."""

    def with_present(self) -> Source | None:
        """Return the source that goes on with the cameras that give pictures; None if they do not
        suffice."""


class Replay:
    """Plays a recorded sequence as its cameras would deliver it: each frame at its own time.

    If decoding is more than a frame late, the frame is dropped undecoded.
    """

    changed = ""

    def __init__(self, sequence: Recording, frames: range) -> None:
        self.rig: CameraRig = sequence.rig
        self.frames = frames
        self.fps = sequence.fps / frames.step
        self.has_images = sequence.has_images
        self.sequence = sequence

    @property
    def background(self) -> Background | None:
        return self.sequence.background

    def first(self) -> Frame:
        return self.sequence.read(self.frames[0])

    def run(self, shots: Newest[Shot], timeline: Timeline, stop: threading.Event) -> None:
        with self.sequence.reader() as read:
            begin = timeline.now()
            for number, index in enumerate(self.frames):
                due = begin + number / self.fps
                if stop.wait(max(0.0, due - timeline.now())):
                    return
                if timeline.now() - due > 1 / self.fps:
                    timeline.drop(ACQUISITION, index)
                    continue
                frame = read(index)
                timeline.add(Span(ACQUISITION, index, due, timeline.now()))
                shots.put(Shot(frame, due))

    def with_present(self) -> Source | None:
        return None


class Smaller:
    """`footage` with images resized by `factor`, at most 1; `resize` does so."""

    def __init__(self, footage: FrameSource, factor: float) -> None:
        shrink = Shrink(footage.rig, factor)
        self.has_images, self.rig = footage.has_images, shrink.small
        self.background = shrink.background(footage.background)
        self.resize = shrink.frame


def fitting_factor(rig: CameraRig, grid: VoxelGrid) -> float:
    """Return the factor of images that are halved repeatedly until a pixel covers a voxel of
    `grid`."""
    halves = int(np.log2(max(grid.voxel_size / finest_pixel(rig, grid), 1.0)))
    return float(0.5**halves)

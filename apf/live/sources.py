"""Sources of live frames: a recorded sequence at its own rate, or cameras."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, Protocol, TypeVar

import cv2
import numpy as np

from apf.backend import FrameSource
from apf.live.config import CaptureConfig
from apf.live.timeline import Span, Timeline
from cl import InputError
from psfs.background.gaussian import Background, clipped_moments
from psfs.cameras.camera import CameraRig
from psfs.footage.media import VIDEO_SUFFIXES
from psfs.sequence import Frame
from psfs.sequence import Sequence as Recording

#: The stage that sources perform.
ACQUISITION = "acquisition"
#: Greatest size of the pictures of the empty scene that are held, bytes, unless these are so few.
_EMPTY_BYTES, _LEAST_EMPTY = 2**29, 10


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
    """The input of live tracking. fps: frames per second."""

    fps: float

    def first(self) -> Frame:
        """Return a frame for the preparation."""

    def run(self, shots: Newest[Shot], timeline: Timeline, stop: threading.Event) -> None:
        """Put shots until the end or `stop`. Raises InputError."""


class Replay:
    """Plays a recorded sequence as its cameras would deliver it: each frame at its own time.

    If decoding is more than a frame late, the frame is dropped undecoded.
    """

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


class LiveCamera:
    """Reads the newest picture of an OpenCV capture, grabbed in a thread of its own.

    name: a USB number, a URL or a video file. A file is read on demand until `play`, and from then
    on at its own rate. Raises InputError if it cannot be opened.
    """

    def __init__(self, name: str, config: CaptureConfig | None = None) -> None:
        config = config or CaptureConfig()
        self.name, self._patience = name, config.patience
        self._capture = cv2.VideoCapture(int(name) if name.isdigit() else name)
        if not self._capture.isOpened():
            raise InputError(f"{name}: cannot be opened; expected a USB number, a URL or a video")
        # without a queue, because only the newest is wanted
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        self.fps = float(rate) if 1 <= rate <= 1000 else config.default_fps
        self._is_file = Path(name).suffix.lower() in VIDEO_SUFFIXES and Path(name).is_file()
        self._condition = threading.Condition()
        self._image: np.ndarray | None = None
        self._time, self._count, self._wanted, self._ended = 0.0, 0, 0, False
        self._began: tuple[float, int] | None = None  # when playing began, and at which picture
        self._stop = False
        self._thread = threading.Thread(target=self._grab, name=f"camera {name}", daemon=True)
        self._thread.start()

    def play(self) -> None:
        """Play a file from its next picture on; no effect on cameras."""
        with self._condition:
            self._began = time.perf_counter(), self._count
            self._condition.notify_all()

    def next(self, after: int) -> tuple[int, float, np.ndarray | None]:
        """Wait for the newest picture with a number above `after`. Return its number, time
        (perf_counter, s) and pixels (h, w, 3); None instead of pixels at the end. Raises InputError
        if the capture fails."""
        with self._condition:
            self._wanted = after + 1
            self._condition.notify_all()
            there = self._condition.wait_for(
                lambda: self._count > after or self._ended, timeout=self._patience
            )
            if not there:
                raise InputError(
                    f"{self.name}: no picture for {self._patience:g} s; expected a camera"
                )
            new = self._count > after
            return self._count, self._time, self._image if new else None

    def close(self) -> None:
        """End the thread, and release the capture."""
        with self._condition:
            self._stop = True
            self._condition.notify_all()
        self._thread.join(self._patience)
        self._capture.release()

    def _grab(self) -> None:
        while not self._stop:
            if self._is_file:
                self._wait_turn()
            came, image = self._capture.read()
            with self._condition:
                if came:
                    self._image, self._time = image, time.perf_counter()
                    self._count += 1
                self._ended = not came
                self._condition.notify_all()
            if not came:
                return

    def _wait_turn(self) -> None:
        """Wait until a file's next picture is due or requested."""
        with self._condition:
            self._condition.wait_for(
                lambda: self._began is not None or self._wanted > self._count or self._stop
            )
        if self._began is not None:
            begin, first = self._began
            due = begin + (self._count - first) / self.fps
            time.sleep(max(0.0, due - time.perf_counter()))


class LiveCameras:
    """Cameras of `rig`, in its order, whose newest pictures form a frame.

    A frame appears when its oldest picture was grabbed. Its index counts steps of 1 / fps s, and is
    greater than the frame's before. The background is the one given, or estimated from the first
    `empty` seconds. Raises InputError if a camera's pictures do not have the size of its
    calibration.
    """

    has_images = True

    def __init__(
        self,
        rig: CameraRig,
        names: Sequence[str],
        background: Background | None,
        empty: float,
        config: CaptureConfig | None = None,
    ) -> None:
        if len(names) != len(rig):
            raise InputError(
                f"{len(names)} captures ({', '.join(names)}); expected {len(rig)}, "
                f"for the cameras {', '.join(rig.names)}"
            )
        self.rig, self._known, self._empty = rig, background, empty
        self._cameras: list[LiveCamera] = []
        with ExitStack() as stack:  # close the opened captures if the next cannot be opened
            for name in names:
                self._cameras.append(LiveCamera(name, config))
                stack.callback(self._cameras[-1].close)
            stack.pop_all()
        self.fps = min(camera.fps for camera in self._cameras)
        self._counts = [0] * len(names)
        self._latest = -1  # number of the latest frame

    @property
    def background(self) -> Background:
        """The background; the first access may record it."""
        if self._known is None:
            frames = self._record_empty(max(1, round(self._empty * self.fps)))
            moments = [
                clipped_moments([images[view] for images in frames])
                for view in range(len(self.rig))
            ]
            mean, std = (np.stack(parts) for parts in zip(*moments, strict=True))
            self._known = Background(mean, std)
        return self._known

    def first(self) -> Frame:
        return Frame(0, self._first_images(), None)

    def run(self, shots: Newest[Shot], timeline: Timeline, stop: threading.Event) -> None:
        with self._closing():
            origin, self._latest = time.perf_counter() - timeline.now(), -1
            for camera in self._cameras:
                camera.play()
            while not stop.is_set():
                shot = self._next(origin)
                if shot is None:
                    return
                timeline.add(Span(ACQUISITION, shot.frame.index, shot.time, timeline.now()))
                shots.put(shot)

    def close(self) -> None:
        """Release all cameras."""
        for camera in self._cameras:
            camera.close()

    def _record_empty(self, count: int) -> list[np.ndarray]:
        """Return the pictures (V, H, W, 3) of the next `count` frames, of a part of them, evenly
        spread, where all would take more than `_EMPTY_BYTES`."""
        first = self._first_images()
        every = -(-count // max(_LEAST_EMPTY, _EMPTY_BYTES // first.nbytes))
        frames = [first]
        for number in range(1, count):
            images = self._first_images()
            if number % every == 0:
                frames.append(images)
        return frames

    def _first_images(self) -> np.ndarray:
        shot = self._next(0.0)
        if shot is None or shot.frame.images is None:
            raise InputError(f"{self._cameras[0].name}: ended before it began; expected pictures")
        return shot.frame.images

    @contextmanager
    def _closing(self) -> Iterator[None]:
        try:
            yield
        finally:
            self.close()

    def _next(self, origin: float) -> Shot | None:
        """Return a frame of pictures that are all new; None at the end of any camera."""
        images = np.zeros((len(self.rig), self.rig.height, self.rig.width, 3), np.uint8)
        oldest = np.inf
        for view, (camera, calibrated) in enumerate(zip(self._cameras, self.rig, strict=True)):
            self._counts[view], when, image = camera.next(self._counts[view])
            if image is None:
                return None
            size = (image.shape[1], image.shape[0])
            if size != calibrated.size:
                raise InputError(
                    f"{camera.name}: {size[0]} x {size[1]} pixels; camera {calibrated.name} is "
                    f"calibrated for {calibrated.size[0]} x {calibrated.size[1]}"
                )
            images[view, : size[1], : size[0]] = image
            oldest = min(oldest, when)
        # Pictures that come unevenly may lie within one step, or before the first.
        self._latest = max(self._latest + 1, round((oldest - origin) * self.fps))
        return Shot(Frame(self._latest, images, None), oldest - origin)

"""Cameras that need no calibration: their newest pictures together, and their recording."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from apf.live.config import CaptureConfig
from apf.live.sources import LiveCamera
from cl import InputError, UserError
from psfs.cameras.camera import CameraRig
from psfs.footage.layouts.uncalibrated import make_nominal_camera
from psfs.output.video import Video, write_video
from psfs.sequence import Frame


class Captures:
    """The cameras of these names (see `LiveCamera`), named cam1, cam2, ... in their order.

    A frame is the newest picture of each; a thread takes one after the other until `close`, or
    until a camera ends. Raises InputError if a camera cannot be opened, or sends nothing.
    """

    def __init__(self, names: Sequence[str], config: CaptureConfig | None = None) -> None:
        self._cameras: list[LiveCamera] = []
        with ExitStack() as stack:  # closes the opened ones if the next cannot be opened
            for name in names:
                self._cameras.append(LiveCamera(name, config))
                stack.callback(self._cameras[-1].close)
            self._counts, pictures = [0] * len(names), list[np.ndarray]()
            for camera in self._cameras:
                count, _, picture = camera.next(0)
                if picture is None:
                    raise InputError(f"{camera.name}: ended before it began; expected pictures")
                self._counts[len(pictures)] = count
                pictures.append(picture)
            stack.pop_all()
        self.rig = CameraRig(
            tuple(
                make_nominal_camera(f"cam{number}", (picture.shape[1], picture.shape[0]))
                for number, picture in enumerate(pictures, 1)
            )
        )
        self.fps = min(camera.fps for camera in self._cameras)
        #: Why no more frames come; empty as long as they do.
        self.ended = ""
        self._newest = self._join(0, pictures)
        self._condition, self._closed = threading.Condition(), threading.Event()
        self._videos: list[Video] = []
        self._files = ExitStack()
        self._began, self._n_written = 0.0, 0
        self._pool = ThreadPoolExecutor(len(self._cameras))
        self._thread = threading.Thread(target=self._work, daemon=True, name="captures")
        self._thread.start()

    def wait(self, after: int, seconds: float = 1.0) -> Frame | None:
        """Return the newest frame, as soon as its number is above `after`; None if none comes in
        this time."""
        with self._condition:
            self._condition.wait_for(lambda: self._newest.index > after or self.ended, seconds)
            return self._newest if self._newest.index > after else None

    def record(self, folder: Path, names: Sequence[str]) -> None:
        """Write the frames from now on into a new folder, as a video per camera, named so."""
        folder.mkdir(parents=True)
        with self._condition:
            self._began, self._n_written = time.perf_counter(), 0
            self._videos = [
                self._files.enter_context(write_video(folder / f"{name}.mp4", self.fps))
                for name in names
            ]

    def stop_recording(self) -> int:
        """Complete the videos; return how many frames they have. A frame that came late stands in
        them twice, so that they play in real time. Raises InputError if nothing was written."""
        with self._condition:
            files, self._files, self._videos = self._files, ExitStack(), []
        files.close()
        return self._n_written

    def close(self) -> None:
        """End all cameras."""
        self._closed.set()
        self._thread.join(timeout=30)
        for camera in self._cameras:
            camera.close()
        self._pool.shutdown()
        self._files.close()

    def _work(self) -> None:
        for camera in self._cameras:
            camera.play()
        try:
            while not self._closed.is_set():
                pictures = []
                for view, camera in enumerate(self._cameras):
                    self._counts[view], _, picture = camera.next(self._counts[view])
                    if picture is None:
                        raise InputError(f"{camera.name} has ended")
                    pictures.append(picture)
                with self._condition:
                    self._newest = self._join(self._newest.index + 1, pictures)
                    if self._videos:
                        self._write(pictures)
                    self._condition.notify_all()
        except (UserError, OSError) as error:  # OSError: the disk is full
            with self._condition:
                self.ended = str(error)
                self._condition.notify_all()

    def _write(self, pictures: Sequence[np.ndarray]) -> None:
        """Write a frame as often as its time says: twice if the one before it is missing."""
        due = 1 + round((time.perf_counter() - self._began) * self.fps)
        for _ in range(max(0, due - self._n_written)):
            list(self._pool.map(Video.write, self._videos, pictures))
            self._n_written += 1

    def _join(self, index: int, pictures: Sequence[np.ndarray]) -> Frame:
        images = np.zeros((len(self.rig), self.rig.height, self.rig.width, 3), np.uint8)
        for view, picture in enumerate(pictures):
            if (picture.shape[1], picture.shape[0]) != self.rig[view].size:
                raise InputError(f"{self._cameras[view].name}: its pictures changed their size")
            images[view, : picture.shape[0], : picture.shape[1]] = picture
        return Frame(index, images, None)

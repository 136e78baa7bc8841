"""Cameras that are read live: their newest pictures together, calibrated for tracking, or without a
calibration to be looked at and recorded."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from copy import copy
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.live.sources import ACQUISITION, Newest, Shot
from apf.live.timeline import Span, Timeline
from cl import InputError, UserError
from psfs.background.gaussian import Background, clipped_moments, estimate_background
from psfs.cameras.calibration import read_calibration
from psfs.cameras.camera import CameraRig
from psfs.cameras.units import rotate_rig, rotation_to_z_up
from psfs.footage.layouts.common import assemble
from psfs.footage.layouts.native import find_settings_calibration
from psfs.footage.layouts.uncalibrated import make_nominal_camera
from psfs.footage.media import VIDEO_SUFFIXES, list_media
from psfs.footage.settings import SequenceSettings
from psfs.output.video import Video, write_video
from psfs.sequence import DEFAULT_FPS, Frame

#: Time between two attempts to read from a camera that gives no picture, s, and time without a new
#: one after which it counts as gone.
_RETRY, _PATIENCE = 0.5, 5.0
#: Greatest size of the pictures of the empty scene that are held, bytes, unless these are so few.
_EMPTY_BYTES, _LEAST_EMPTY = 2**29, 10
#: Side of a box that holds a person, as a multiple of the greatest distance of the joints at rest.
_BOX = 1.5


class GoneError(InputError):
    """Error of a camera that gives no more pictures."""


class LiveCamera:
    """Reads the newest picture of an OpenCV capture, grabbed in a thread of its own.

    name: a USB number, a URL or a video file. A file is read on demand until `play`, and from then
    on at its own rate. A camera whose pictures cease is opened again until it counts as gone.
    Raises InputError if it cannot be opened.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._where: int | str = int(name) if name.isdigit() else name
        self._capture = cv2.VideoCapture(self._where)
        if not self._capture.isOpened():
            raise InputError(f"{name}: cannot be opened; expected a USB number, a URL or a video")
        # without a queue, because only the newest is wanted
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        self.fps = float(rate) if 1 <= rate <= 1000 else DEFAULT_FPS
        self._is_file = Path(name).suffix.lower() in VIDEO_SUFFIXES and Path(name).is_file()
        self._condition = threading.Condition()
        self._image: np.ndarray | None = None
        self._time, self._count, self._wanted, self._ended = 0.0, 0, 0, False
        self._count_when_gone: int | None = None
        self._began: tuple[float, int] | None = None  # when playing began, and at which picture
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._grab, name=f"camera {name}", daemon=True)
        self._thread.start()

    @property
    def gives_pictures(self) -> bool:
        """Whether pictures come, as far as is known; also again after they ceased."""
        return self._count_when_gone is None or self._count > self._count_when_gone

    def lose(self, why: str) -> GoneError:
        """Count as gone until the next picture; return the error."""
        self._count_when_gone = self._count
        return GoneError(f"{self.name} gives no more pictures: {why}")

    def play(self) -> None:
        """Play a file from its next picture on; no effect on cameras."""
        with self._condition:
            self._began = time.perf_counter(), self._count
            self._condition.notify_all()

    def next(self, after: int) -> tuple[int, float, np.ndarray | None]:
        """Wait for the newest picture with a number above `after`. Return its number, time
        (perf_counter, s) and pixels (h, w, 3); None instead of pixels at the end of a file. Raises
        GoneError if no picture comes for too long."""
        with self._condition:
            self._wanted = after + 1
            self._condition.notify_all()
            there = self._condition.wait_for(
                lambda: self._count > after or self._ended, timeout=_PATIENCE
            )
            if not there:
                raise self.lose(f"none for {_PATIENCE:g} s after {self._count}")
            new = self._count > after
            return self._count, self._time, self._image if new else None

    def close(self) -> None:
        """End the thread, and release the capture."""
        self._stop.set()
        with self._condition:
            self._condition.notify_all()
        self._thread.join(_PATIENCE)
        if not self._thread.is_alive():  # else a driver hangs in it
            self._capture.release()

    def _grab(self) -> None:
        while not self._stop.is_set():
            if self._is_file:  # wait until its next picture is due or requested
                with self._condition:
                    self._condition.wait_for(
                        lambda: self._began or self._wanted > self._count or self._stop.is_set()
                    )
                if self._began is not None:
                    due = self._began[0] + (self._count - self._began[1]) / self.fps
                    time.sleep(max(0.0, due - time.perf_counter()))
            came, image = self._capture.read()
            with self._condition:
                if came:
                    self._image, self._time = image, time.perf_counter()
                    self._count += 1
                self._ended = self._is_file and not came
                self._condition.notify_all()
            if self._ended:
                return
            if not came and not self._stop.wait(_RETRY):
                self._capture.open(self._where)


class Cameras:
    """Cameras by the names of their captures, see `LiveCamera`; their newest pictures are a frame.

    Raises InputError if one cannot be opened.
    """

    rig: CameraRig

    def __init__(self, names: Sequence[str]) -> None:
        self.cameras: list[LiveCamera] = []
        with ExitStack() as stack:  # closes the opened ones if the next cannot be opened
            for name in names:
                self.cameras.append(LiveCamera(name))
                stack.callback(self.cameras[-1].close)
            stack.pop_all()
        self.fps = min(camera.fps for camera in self.cameras)
        self._counts = [0] * len(names)

    def play(self) -> None:
        """Play files from their next pictures on."""
        for camera in self.cameras:
            camera.play()

    def next_pictures(self) -> tuple[list[np.ndarray], float] | None:
        """Return a new picture of each camera, and when the oldest was grabbed (perf_counter, s);
        None at the end of one. Raises GoneError."""
        pictures, oldest = list[np.ndarray](), np.inf
        for view, camera in enumerate(self.cameras):
            self._counts[view], when, picture = camera.next(self._counts[view])
            if picture is None:
                return None
            pictures.append(picture)
            oldest = min(oldest, when)
        return pictures, oldest

    def first_pictures(self) -> list[np.ndarray]:
        """Return pictures for the preparation. Raises InputError if a camera has none."""
        found = self.next_pictures()
        if found is None:
            ended = min(zip(self._counts, self.cameras, strict=True), key=lambda pair: pair[0])[1]
            raise InputError(f"{ended.name}: ended before it began; expected pictures")
        return found[0]

    def join(self, pictures: Sequence[np.ndarray]) -> np.ndarray:
        """Return pictures as one array (V, H, W, 3). Raises InputError for one whose size is not
        that of its camera in the rig."""
        images = np.zeros((len(self.rig), self.rig.height, self.rig.width, 3), np.uint8)
        rows = zip(images, pictures, self.cameras, self.rig, strict=True)
        for image, picture, camera, known in rows:
            size = picture.shape[1], picture.shape[0]
            if size != known.size:
                raise InputError(
                    f"{camera.name}: {size[0]} x {size[1]} pixels; camera {known.name} is "
                    f"calibrated for {known.size[0]} x {known.size[1]}"
                )
            image[: size[1], : size[0]] = picture
        return images

    def close(self) -> None:
        """Release all cameras."""
        for camera in self.cameras:
            camera.close()


class LiveCameras(Cameras):
    """Cameras of `rig`, in its order, as a source of live tracking.

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
    ) -> None:
        if len(names) != len(rig):
            raise InputError(
                f"{len(names)} captures ({', '.join(names)}); expected {len(rig)}, "
                f"for the cameras {', '.join(rig.names)}"
            )
        super().__init__(names)
        self.rig, self._known, self._empty = rig, background, empty
        self._whole = self  # with all cameras
        self.changed = ""
        self._latest = -1  # number of the latest frame

    @property
    def background(self) -> Background:
        """The background; the first access may record it."""
        if self._known is None:
            count = max(1, round(self._empty * self.fps))
            frames = [self.join(self.first_pictures())]
            # a part, evenly spread, where all would take more than `_EMPTY_BYTES`
            every = -(-count // max(_LEAST_EMPTY, _EMPTY_BYTES // frames[0].nbytes))
            for number in range(1, count):
                pictures = self.first_pictures()
                if number % every == 0:
                    frames.append(self.join(pictures))
            self._known = average_pictures(frames)
        return self._known

    def first(self) -> Frame:
        return Frame(0, self.join(self.first_pictures()), None)

    def run(self, shots: Newest[Shot], timeline: Timeline, stop: threading.Event) -> None:
        origin = time.perf_counter() - timeline.now()
        self.play()
        try:
            while not stop.is_set() and (found := self.next_pictures()) is not None:
                pictures, oldest = found
                # Pictures that come unevenly may lie within one step, or before the first.
                self._latest = max(self._latest + 1, round((oldest - origin) * self.fps))
                frame = Frame(self._latest, self.join(pictures), None)
                timeline.add(Span(ACQUISITION, frame.index, oldest - origin, timeline.now()))
                shots.put(Shot(frame, oldest - origin))
                every = self._whole.cameras
                back = [c.name for c in every if c.gives_pictures and c not in self.cameras]
                if back:
                    self.changed = f"{', '.join(back)} gives pictures again"
                    break
        except GoneError as error:
            self.changed = str(error)
        if not self.changed:
            self._whole.close()

    def with_present(self) -> LiveCameras | None:
        """Return the cameras that give pictures, as a source that goes on; None, after which all
        are released, if those are fewer than two."""
        whole = self._whole
        views = [view for view, camera in enumerate(whole.cameras) if camera.gives_pictures]
        if len(views) < 2:
            whole.close()
            return None
        rest = copy(self)
        rest.rig = CameraRig(tuple(whole.rig[view] for view in views))
        rest.cameras = [whole.cameras[view] for view in views]
        rest._counts, rest.changed = [0] * len(views), ""
        mean, std = (
            values[views][:, : rest.rig.height, : rest.rig.width]
            for values in (whole.background.mean, whole.background.std)
        )
        rest._known = replace(whole.background, mean=mean, std=std)
        try:
            rest.first_pictures()
        except GoneError:
            return rest.with_present()
        return rest


class Captures(Cameras):
    """Cameras that need no calibration, named cam1, cam2, ... in their order.

    A thread takes one frame after the other until `close`, or until a camera ends. Raises
    InputError if a camera cannot be opened, or sends nothing.
    """

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(names)
        try:
            pictures = self.first_pictures()
        except UserError:
            super().close()
            raise
        self.rig = CameraRig(
            tuple(
                make_nominal_camera(f"cam{number}", (picture.shape[1], picture.shape[0]))
                for number, picture in enumerate(pictures, 1)
            )
        )
        #: Why no more frames come; empty as long as they do.
        self.ended = ""
        self._newest = Frame(0, self.join(pictures), None)
        self._condition, self._closed = threading.Condition(), threading.Event()
        self._videos: list[Video] = []
        self._files = ExitStack()
        self._began, self._n_written = 0.0, 0
        self._pool = ThreadPoolExecutor(len(self.cameras))
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
        super().close()
        self._pool.shutdown()
        self._files.close()

    def _work(self) -> None:
        self.play()
        ended = ""
        try:
            while not self._closed.is_set() and (found := self.next_pictures()) is not None:
                with self._condition:
                    self._newest = Frame(self._newest.index + 1, self.join(found[0]), None)
                    if self._videos:
                        self._write(found[0])
                    self._condition.notify_all()
            ended = "a camera has ended"
        except (UserError, OSError) as error:  # OSError: the disk is full
            ended = str(error)
        with self._condition:
            self.ended = ended
            self._condition.notify_all()

    def _write(self, pictures: Sequence[np.ndarray]) -> None:
        """Write a frame as often as its time says: twice if the one before it is missing."""
        due = 1 + round((time.perf_counter() - self._began) * self.fps)
        for _ in range(max(0, due - self._n_written)):
            list(self._pool.map(Video.write, self._videos, pictures))
            self._n_written += 1


def average_pictures(frames: Sequence[np.ndarray]) -> Background:
    """Return the background of pictures (V, H, W, 3) uint8 of the empty scene."""
    moments = [clipped_moments(list(pictures)) for pictures in zip(*frames, strict=True)]
    mean, std = (np.stack(parts) for parts in zip(*moments, strict=True))
    return Background(mean, std)


def open_cameras(
    folder: Path, stated: dict[str, object], names: list[str], empty: float
) -> LiveCameras:
    """Open the captures `names` as the cameras, in this order, of the calibration in `folder`.

    `folder` may be the calibration file itself. stated: keys of `sequence.toml` that override those
    of the file. The background images are those in `folder/background`, if it exists. Raises
    InputError.
    """
    settings, calibration = SequenceSettings.from_dict(stated), folder
    if not folder.is_file():
        settings = settings.fill_from(SequenceSettings.read(folder / "sequence.toml"))
        calibration = find_settings_calibration(folder, settings)
    pictures, calibrated = folder / "background", read_calibration(calibration, settings.unit)
    files = list_media(pictures) if pictures.is_dir() else {}
    footage = assemble(calibrated, settings, {"background": (files, pictures)})
    rig = rotate_rig(footage.rig, rotation_to_z_up(settings.up or "z"))
    background = estimate_background(rig, footage.background) if footage.background else None
    return LiveCameras(rig, names, background, empty)


def box_around(body: BodyModel, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest corner (3,) m of a box that holds the person in any posture
    at the place of `pose` (D,)."""
    joints, upright = posed_joints(body, np.stack([pose, body.rest_pose]))
    half = _BOX / 2 * float(np.linalg.norm(upright[:, None] - upright, axis=-1).max())
    return joints.mean(0) - half, joints.mean(0) + half

"""Pictures of the frame that is shown, decoded by a thread that serves the latest request only."""

from __future__ import annotations

import threading
from collections.abc import Callable

import cv2
import numpy as np

from apf.body.kinematics import posed_cones
from apf.report.overlay import overlay_picture
from apf.studio.opened import Opened
from cl import UserError
from psfs.output.preview import crop_view
from psfs.sequence import Frame, Sequence

#: Least time between two pictures while playing, s, and widths of pictures on the page, px.
_PAUSE = 0.2
_FRUSTUM_WIDTH, _WIDTH = 320, 720


class PictureReader:
    """Decoder of requested frames, each passed to `show`; a request that comes while it works
    replaces the one before. fail: receives the text of an error, after which it ends."""

    def __init__(
        self, sequence: Sequence, show: Callable[[Frame], object], fail: Callable[[str], object]
    ) -> None:
        self._sequence, self._show, self._fail = sequence, show, fail
        self._wanted: int | None = None
        self._woken, self._ended = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True, name="pictures")
        self._thread.start()

    def ask(self, frame: int) -> None:
        """Ask for the pictures of a frame."""
        self._wanted = frame
        self._woken.set()

    def close(self) -> None:
        """End the thread."""
        self._ended.set()
        self._woken.set()
        self._thread.join(timeout=30)

    def _work(self) -> None:
        try:
            with self._sequence.reader(learning=False) as read:
                while True:
                    self._woken.wait()
                    self._woken.clear()
                    if self._ended.is_set():
                        return
                    if self._wanted is not None:
                        self._show(read(self._wanted))
                    self._ended.wait(_PAUSE)
        except UserError as error:
            self._fail(f"no pictures: {error}")


def small_pictures(frame: Frame, sequence: Sequence) -> list[np.ndarray]:
    """Return each camera's picture (h, w, 3) uint8 RGB, small, as its frustum shows it."""
    found = []
    for view, camera in enumerate(sequence.rig):
        picture = crop_view(frame, view, camera)
        scale = min(1.0, _FRUSTUM_WIDTH / picture.shape[1])
        small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        found.append(np.ascontiguousarray(small[..., ::-1]))
    return found


def mosaic(pictures: list[np.ndarray]) -> np.ndarray:
    """Return pictures (h, w, 3) uint8 side by side, in as many rows as columns."""
    columns = int(np.ceil(np.sqrt(len(pictures))))
    rows = -(-len(pictures) // columns)
    height = max(picture.shape[0] for picture in pictures)
    width = max(picture.shape[1] for picture in pictures)
    whole = np.zeros((rows * height, columns * width, 3), np.uint8)
    for number, picture in enumerate(pictures):
        y, x = height * (number // columns), width * (number % columns)
        whole[y : y + picture.shape[0], x : x + picture.shape[1]] = picture
    return whole


def draw_people(frame: Frame, opened: Opened, view: int | None) -> np.ndarray:
    """Return the picture (h, w, 3) uint8 RGB of a frame with all bodies; of one camera (its index)
    or, for None, of all."""
    assert opened.sequence is not None
    cones: list[np.ndarray] = []
    names: list[str] = []
    joints: list[np.ndarray] = []
    edges: list[np.ndarray] = []
    for name, track in opened.tracks.items():
        row = opened.rows[name].get(frame.index)
        if row is None or track.lost[row]:
            continue
        body = track.its_body
        drawn = [number for number, cone in enumerate(body.cones) if cone.in_images]
        edges.append(track.edges + sum(len(of) for of in joints))
        cones.append(posed_cones(body, track.poses[[row]])[0, drawn])
        names += [body.cone_names[number] for number in drawn]
        joints.append(track.joints[row])
    empty = np.zeros((0, 16)), np.zeros((0, 3)), np.zeros((0, 2), int)
    whole = [
        np.concatenate([of_none, *of])
        for of_none, of in zip(empty, (cones, joints, edges), strict=True)
    ]
    picture = overlay_picture(
        frame, opened.sequence.rig, whole[0], names, whole[1], whole[2],
        views=None if view is None else [view],
    )  # fmt: skip
    scale = min(1.0, _WIDTH / picture.shape[1])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(small[..., ::-1])

"""Pictures of the frame that is shown, decoded by a thread that serves the latest request only."""

from __future__ import annotations

import threading
from collections.abc import Callable

import cv2
import numpy as np

from cl import UserError
from psfs.cameras.camera import CameraRig
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


def small_pictures(frame: Frame, rig: CameraRig) -> list[np.ndarray]:
    """Return each camera's picture (h, w, 3) uint8 RGB, small, as its frustum shows it."""
    return [
        shrink_picture(crop_view(frame, view, camera), _FRUSTUM_WIDTH)
        for view, camera in enumerate(rig)
    ]


def draw_views(frame: Frame, rig: CameraRig, view: int | None) -> np.ndarray:
    """Return the picture (h, w, 3) uint8 RGB of one camera (its index) or, for None, of all."""
    pictures = []
    for one in range(len(rig)) if view is None else [view]:
        picture = crop_view(frame, one, rig[one]).copy()
        size = max(picture.shape[:2]) / 800
        for colour, thickness in ((0, 0, 0), 4), ((255, 255, 255), 1):
            cv2.putText(
                picture, rig[one].name, (round(10 * size), round(36 * size)),
                cv2.FONT_HERSHEY_SIMPLEX, size, colour, max(1, round(thickness * size)),
                cv2.LINE_AA,
            )  # fmt: skip
        pictures.append(picture)
    return shrink_picture(mosaic(pictures))


def shrink_picture(picture: np.ndarray, width: int = _WIDTH) -> np.ndarray:
    """Return a picture (h, w, 3) uint8 BGR at most `width` px wide, as RGB."""
    scale = min(1.0, width / picture.shape[1])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(small[..., ::-1])


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

"""Pictures of the frame that is shown, decoded by a thread that serves the latest request only."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import cv2
import numpy as np

from cl import UserError
from psfs.cameras.camera import CameraRig
from psfs.common.pictures import scale_picture
from psfs.output.preview import crop_view, label_picture, tile_pictures
from psfs.page.words import REFRESH
from psfs.sequence import Frame, Sequence

if TYPE_CHECKING:
    import viser

#: Widths of pictures on the page, px.
_FRUSTUM_WIDTH, _WIDTH = 320, 720
#: RGB of the silhouettes, a colour that is rare in rooms.
_SILHOUETTE = np.array([255, 0, 200])
_MARGIN = (40, 40, 40)


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
                    self._ended.wait(REFRESH)
        except UserError as error:
            self._fail(f"no pictures: {error}")


def small_pictures(frame: Frame, rig: CameraRig, width: int = _FRUSTUM_WIDTH) -> list[np.ndarray]:
    """Return each camera's picture (h, w, 3) uint8 RGB, at most `width` px wide; by default as its
    frustum shows it."""
    return [
        shrink_picture(crop_view(frame, view, camera), width) for view, camera in enumerate(rig)
    ]


def draw_views(frame: Frame, rig: CameraRig, view: int | None) -> np.ndarray:
    """Return the picture (h, w, 3) uint8 RGB of one camera (its index) or, for None, of all."""
    pictures = [
        label_picture(crop_view(frame, one, rig[one]).copy(), rig[one].name)
        for one in (range(len(rig)) if view is None else [view])
    ]
    return shrink_picture(mosaic(pictures))


def shrink_picture(picture: np.ndarray, width: int = _WIDTH) -> np.ndarray:
    """Return a picture (h, w, 3) uint8 BGR at most `width` px wide, as RGB."""
    scale = min(1.0, width / picture.shape[1])
    return np.ascontiguousarray(scale_picture(picture, scale)[..., ::-1])


def fill_view(server: viser.ViserServer, picture: np.ndarray | None) -> None:
    """Show a picture (h, w, 3) uint8 RGB, as large as possible, in the 3-D view of each browser;
    for None nothing."""
    for client in server.get_clients().values():
        if picture is None:
            client.scene.set_background_image(None)
            continue
        height, width = picture.shape[:2]
        wide = max(width, round(height * client.camera.aspect))
        high = max(height, round(wide / client.camera.aspect))
        down, right = (high - height) // 2, (wide - width) // 2
        whole = cv2.copyMakeBorder(
            picture, down, high - height - down, right, wide - width - right,
            cv2.BORDER_CONSTANT, value=_MARGIN,
        )  # fmt: skip
        client.scene.set_background_image(whole, format="jpeg")


def blend_silhouette(picture: np.ndarray, shown: np.ndarray, opacity: float) -> np.ndarray:
    """Return a picture (h, w, 3) uint8 RGB with a silhouette (h', w') bool drawn over it."""
    size = picture.shape[1], picture.shape[0]
    share = opacity * cv2.resize(shown.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    mixed = picture * (1 - share[..., None]) + _SILHOUETTE * share[..., None]
    return np.rint(mixed).astype(np.uint8)


def mosaic(pictures: list[np.ndarray]) -> np.ndarray:
    """Return pictures (h, w, 3) uint8 side by side, in as many rows as columns."""
    n = int(np.ceil(np.sqrt(len(pictures))))
    return tile_pictures([pictures[first : first + n] for first in range(0, len(pictures), n)])

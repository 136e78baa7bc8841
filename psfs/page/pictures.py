"""Pictures of the frame that is shown, decoded by a thread that serves the latest request only, and
the 3-D view as one of the footage's cameras has it, with its picture behind the scene."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import cv2
import numpy as np

from cl import UserError
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.triangulation import intersect_rays
from psfs.common.pictures import scale_picture
from psfs.output.preview import crop_view, label_picture, tile_pictures
from psfs.page.nodes import to_quaternion
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


#: Height of the picture behind the scene, px; and by how far the point of view may have moved, m.
_HEIGHT, _MOVED = 720, 0.01
#: Cosine of the angle between rays below which they cross: 30 degrees.
_ALONG = 0.87


class LookThrough:
    """The point of view of all browsers on the page: free, or that of a camera of `rig`.

    pointed: called with the camera's index and the direction (3,) of a point of its picture that a
    user clicked.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        rig: CameraRig,
        pointed: Callable[[int, np.ndarray], object],
    ) -> None:
        self._server, self._rig, self._pointed = server, rig, pointed
        self.view: int | None = None
        self._before: dict[int, tuple[np.ndarray, np.ndarray, float]] = {}
        self._map: tuple[tuple[int, float], np.ndarray] | None = None  # of the last picture
        self._on_click = self._click  # one object, by which it is removed
        server.scene.on_click()(self._on_click)

    def choose(self, view: int | None) -> None:
        """Look through a camera, by its index; for None from where the user looked before."""
        clients = self._server.get_clients()
        if self.view is None:
            self._before = {
                number: (client.camera.wxyz, client.camera.position, client.camera.fov)
                for number, client in clients.items()
            }
        self.view = view
        for number, client in clients.items():
            if view is not None:
                camera = self._rig[view]
                place = to_quaternion(camera.R.T), camera.centre, find_fov(camera, client)
            else:
                client.scene.set_background_image(None)
                if number not in self._before:  # it came later
                    continue
                place = self._before[number]
            with client.atomic():
                client.camera.wxyz, client.camera.position, client.camera.fov = place

    def show(self, frame: Frame) -> None:
        """Show the camera's picture of a frame behind the scene."""
        if self.view is None:
            return
        camera = self._rig[self.view]
        picture = crop_view(frame, self.view, camera)
        for client in self._server.get_clients().values():
            key = self.view, client.camera.aspect
            if self._map is None or self._map[0] != key:
                pixels = find_straight_map(camera, find_fov(camera, client), client.camera.aspect)
                self._map = key, pixels
            straight = cv2.remap(picture, self._map[1], None, cv2.INTER_LINEAR)  # type: ignore[call-overload]
            client.scene.set_background_image(
                cv2.cvtColor(straight, cv2.COLOR_BGR2RGB), format="jpeg"
            )

    def close(self) -> None:
        """Look freely again, and take no more clicks."""
        if self.view is not None:
            self.choose(None)
        self._server.scene.remove_click_callback(self._on_click)

    def _click(self, event: viser.SceneClickEvent) -> None:
        """Pass on a click on the picture, unless the user has turned the view since."""
        if self.view is None:
            return
        camera = self._rig[self.view]
        if np.linalg.norm(np.array(event.ray_origin) - camera.centre) < _MOVED:
            self._pointed(self.view, np.array(event.ray_direction))


def find_fov(camera: Camera, client: viser.ClientHandle) -> float:
    """Return the vertical angle of view, rad, in which a browser shows a camera's whole picture
    around the optical axis."""
    (width, height), K = camera.size, camera.K
    across = max(K[0, 2], width - K[0, 2]) / K[0, 0] / client.camera.aspect
    down = max(K[1, 2], height - K[1, 2]) / K[1, 1]
    return float(2 * np.arctan(max(across, down)))


def find_straight_map(camera: Camera, fov: float, aspect: float) -> np.ndarray:
    """Return the pixels (h, w, 2) float32 of a camera's picture that a camera without distortion
    has whose optical axis meets the middle of its picture: `fov` rad high, `aspect` times as wide
    as high."""
    width = round(aspect * _HEIGHT)
    focal = _HEIGHT / 2 / np.tan(fov / 2)
    x, y = np.meshgrid(np.arange(width) - (width - 1) / 2, np.arange(_HEIGHT) - (_HEIGHT - 1) / 2)
    rays = np.stack([x, y, np.full_like(x, focal)], -1).reshape(-1, 3) / focal
    pixels, _ = camera.project(rays @ camera.R + camera.centre)
    return pixels.astype(np.float32).reshape(_HEIGHT, width, 2)


def locate_point(rays: Mapping[int, np.ndarray], rig: CameraRig) -> tuple[np.ndarray, float]:
    """Return the point (3,) m nearest to all rays, directions (3,) by the index of their camera,
    and its largest distance to one of them, m. Expects two rays or more."""
    centres = rig.centres[list(rays)]
    directions = np.stack([way / np.linalg.norm(way) for way in rays.values()])
    point = intersect_rays(centres, directions)
    off = np.linalg.norm(np.cross(directions, point - centres), axis=1)
    return point, float(off.max())


def crosses(rays: Mapping[int, np.ndarray]) -> bool:
    """Return whether two of the rays, directions (3,), cross well enough to tell how far a point
    is."""
    ways = np.stack([way / np.linalg.norm(way) for way in rays.values()])
    return bool(np.abs(ways @ ways.T).min() < _ALONG)

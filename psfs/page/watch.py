"""Watching a run: the 3-D view of its voxels, the time line, its pictures."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cl import InputError, UserError
from psfs.page.clouds import COLOURINGS, CarvedClouds, Clouds, Opened, describe_scale
from psfs.page.nodes import CameraNodes, VoxelNode, add_floor
from psfs.page.pictures import LookThrough, PictureReader, draw_views, small_pictures
from psfs.page.server import BrowserPage, look
from psfs.page.timeline import TimeLine, add_key
from psfs.page.words import REFRESH, make_lines, make_scale, make_text
from psfs.sequence import Frame

if TYPE_CHECKING:
    import viser

_ALL, _FREE = "all cameras", "(none)"
#: Position of the viewer relative to the grid's centre, times the grid's diagonal.
_VIEWER = np.array([0.75, -1.0, 0.35])
#: Of a picture that a browser is asked for: its height and width, px, and the longest wait for it
#: and the time above which the browser has no graphics chip, s. Software takes 0.7 to 1.8 s.
_SIZE, _PATIENCE, _SLOW = (9, 16), 5.0, 0.4


class Watch:
    """A run's voxels on the page, shown until `close`; a subclass adds what was tracked in them.

    server: viser's. opened: see `Opened`; it is closed with this. panel: the tab of what is shown.
    beside: the tab of pictures. line: where the time line stands; by default in `panel`.
    """

    #: What can be shown and hidden, in the order of the keys 1, 2, ...
    layers: tuple[str, ...] = ("voxels", "cameras")
    #: The name of the tab `beside`.
    beside_label = "Pictures"

    def __init__(
        self, server: viser.ViserServer, opened: Opened, panel: Any, beside: Any, line: Any = None
    ) -> None:
        self._server, self.opened = server, opened
        self._closed, self._reader = threading.Event(), None
        self._position, self._status_time, self._timed = -1, 0.0, False
        self._cameras: CameraNodes | None = None
        self._looking: LookThrough | None = None
        #: Called with a camera's index and the direction of what was clicked in its picture.
        self.pointed: Callable[[int, np.ndarray], object] = lambda view, way: None
        self._add_nodes(server.scene)
        with line or panel:
            self.status, stops = server.gui.add_html(""), self._find_stops()
            self.time_line = TimeLine(server.gui, opened.frames, opened.fps, self._show, stops)
        with panel:
            self._add_controls(server.gui)
        with beside:
            self._add_pictures(server.gui)
        if opened.sequence is not None:
            self._reader = PictureReader(opened.sequence, self._show_pictures, self._fail)
        self.time_line.refresh()
        self._want_voxels()

    def _add_nodes(self, scene: viser.SceneApi) -> None:
        """Add what the 3-D view shows."""
        clouds, sequence = self.opened.clouds, self.opened.sequence
        self.voxels = VoxelNode(scene, clouds.grid if clouds is not None else None)
        add_floor(scene, self.opened.box)
        if sequence is not None:
            self._cameras = CameraNodes(scene, sequence.rig)
            self._looking = LookThrough(
                self._server, sequence.rig, lambda view, way: self.pointed(view, way)
            )
        look_at, position = self._first_view()
        self._server.initial_camera.look_at = look_at
        self._server.initial_camera.position = position
        scene.set_up_direction("+z")

    def _add_controls(self, gui: viser.GuiApi) -> None:
        clouds = self.opened.clouds
        self._boxes: dict[str, Any] = {
            name: gui.add_checkbox(
                name,
                name != "voxels" or (clouds is not None and self.opened.voxels_shown),
                hint=f"key: {number}",
            )
            for number, name in enumerate(self.layers, 1)
        }
        for box in self._boxes.values():
            box.on_update(lambda event: self._choose_layers())
        colourings = clouds.colourings if clouds is not None else COLOURINGS[:1]
        self.colouring: Any = gui.add_dropdown(
            "colour by", colourings, initial_value=colourings[0], visible=len(colourings) > 1,
            hint="key: V; the pictures' colours, how sure a voxel is, or its height",
        )  # fmt: skip
        self.colouring.on_update(lambda event: self._choose_colouring())
        self.scale = gui.add_html("")
        self._coarse: Any = gui.add_checkbox(
            "coarse while playing", False, visible=clouds is not None,
            hint="fewer, larger voxels; set by itself where the browser has no graphics chip",
        )  # fmt: skip
        self.remarks = gui.add_html(self._describe())
        self._parts: list[Any] = [
            self.status, self.remarks, self._coarse, self.colouring, self.scale,
            *self._boxes.values(), *(add_key(gui, *key) for key in self.list_keys()),
        ]  # fmt: skip

    def list_keys(self) -> list[tuple[str, str, Callable[[], None]]]:
        """Return label, key and effect of each key beside those of the time line."""
        keys: list[tuple[str, str, Callable[[], None]]] = [
            (f"Show or hide {name}", str(number), lambda name=name: self._toggle(name))  # type: ignore[misc]
            for number, name in enumerate(self.layers, 1)
        ]
        keys.append(("Look from the start", "R", self.look_from_start))
        if self.colouring.visible:
            keys.append(("Next colouring", "V", self._next_colouring))
        return keys

    def _add_pictures(self, gui: viser.GuiApi) -> None:
        if self.opened.sequence is None:
            return
        names = [_ALL, *self.opened.sequence.rig.names]
        self._view = gui.add_dropdown("camera", names, initial_value=_ALL)
        self._view.on_update(lambda event: self._ask_pictures())
        self.through = gui.add_dropdown(
            "look through", (_FREE, *self.opened.sequence.rig.names), initial_value=_FREE,
            hint="the 3-D view as this camera has it, before its picture",
        )  # fmt: skip
        self.through.on_update(lambda event: self._look_through())
        self._picture = gui.add_image(np.zeros((90, 160, 3), np.uint8), format="jpeg")
        self._parts += [self.through, self._view, self._picture]

    @property
    def frame(self) -> int:
        """Number of the frame that is shown."""
        return int(self.opened.frames[self.time_line.position])

    @property
    def shown(self) -> dict[str, bool]:
        """Whether each layer is shown."""
        return {name: bool(box.value) for name, box in self._boxes.items()}

    def go_to_frame(self, frame: int) -> None:
        """Show a frame of the run, by its number. Raises InputError."""
        frames = self.opened.frames.tolist()
        if frame not in frames:
            folder, first, last = self.opened.folder, frames[0], frames[-1]
            raise InputError(f"{folder}: no frame {frame}; it holds frames {first} to {last}")
        self.time_line.seek(frames.index(frame))

    def show_layer(self, layer: str) -> None:
        """Show a layer that may be hidden."""
        self._boxes[layer].value = True

    def show_carved(self, frame: int) -> None:
        """Show voxels that have just become known, if they are of the frame that is shown."""
        if self._closed.is_set():
            return
        if frame == self.frame:
            self.time_line.refresh()
        elif frame % 10 == 0 or frame < 0:
            self._say_status(self.time_line.position)

    def look_from_start(self) -> None:
        """Look from where the page began."""
        look(self._server, *self._first_view())

    def close(self) -> None:
        """End all work in the background, and remove everything from the page."""
        self._closed.set()
        self.time_line.close()
        if self._reader is not None:
            self._reader.close()
        if self._looking is not None:
            self._looking.close()
        self.opened.close()
        for part in self._parts:
            part.remove()
        self._server.scene.reset()

    # What a subclass adds to.

    def _find_stops(self) -> Sequence[int]:
        """Return the positions of the frames to check."""
        return ()

    def _show_frame(self, frame: int) -> None:
        """Show a frame in 3-D."""
        clouds = self.opened.clouds
        if clouds is not None and self._boxes["voxels"].value:
            self._show_voxels(clouds, frame)

    def _describe_frame(self, frame: int) -> list[tuple[str, object]]:
        """Return lines about a frame, for `make_lines`."""
        clouds = self.opened.clouds
        words = clouds.describe(frame) if clouds is not None else ""
        return [("note", words)] if words else []

    def _list_notes(self) -> list[tuple[str, object]]:
        """Return lines about the run, for `make_lines`."""
        return [("warning", remark) for remark in self.opened.remarks]

    def _draw_picture(self, frame: Frame, view: int | None) -> np.ndarray:
        """Return the picture (h, w, 3) uint8 RGB of one camera or, for None, of all."""
        assert self.opened.sequence is not None
        return draw_views(frame, self.opened.sequence.rig, view)

    def _show_layers(self, shown: dict[str, bool]) -> None:
        """Show or hide the layers."""
        if self._cameras is not None and self._looking is not None:
            self._cameras.set_visible(shown["cameras"] and self._looking.view is None)
        self._want_voxels()
        if not shown.get("voxels"):
            self.voxels.show(None)

    # Events.

    def _describe(self) -> str:
        """Return the words about the run, HTML."""
        heading = make_text(f"{self.opened.folder.name}: {len(self.opened.frames)} frames")
        return heading + make_lines(self._list_notes())

    def _show(self, position: int) -> None:
        """Show a frame in 3-D, and ask for its pictures."""
        if self._closed.is_set():
            return
        with self._server.atomic():
            self._show_frame(int(self.opened.frames[position]))
        now, playing = time.monotonic(), self.time_line.playing
        if not playing or (self._position != position and now - self._status_time > REFRESH):
            self._position, self._status_time = position, now
            self._say_status(position)
            self._ask_pictures()

    def _show_voxels(self, clouds: Clouds, frame: int) -> None:
        try:
            points = clouds.get(frame)
            if points is not None and points.blocks is not None and self.time_line.playing:
                if not self._timed:
                    self._timed = True
                    threading.Thread(target=self._time_browsers, daemon=True).start()
                points = points.blocks if self._coarse.value else points
            self.voxels.show(points)
        except UserError as error:  # a file that is gone or damaged
            self.voxels.show(None)
            self._fail(f"no voxels of frame {frame}: {error}")

    def _time_browsers(self) -> None:
        """Have voxels shown coarsely while playing if a browser draws slowly."""
        if draws_slowly(self._server) and not self._closed.is_set():
            self._coarse.value = True

    def _say_status(self, position: int) -> None:
        frame = int(self.opened.frames[position])
        heading: tuple[str, object] = "note", f"frame {frame} · {frame / self.opened.fps:.2f} s"
        self.status.content = make_lines([heading, *self._describe_frame(frame)])

    def _choose_layers(self) -> None:
        self._show_layers(self.shown)
        self.time_line.refresh()

    def _toggle(self, layer: str) -> None:
        self._boxes[layer].value = not self._boxes[layer].value

    def _choose_colouring(self) -> None:
        clouds = self.opened.clouds
        if clouds is not None:
            clouds.choose_colouring(self.colouring.value)
            low, high = float(clouds.grid.low[2]), float(clouds.grid.high[2])
            self.scale.content = make_scale(*describe_scale(self.colouring.value, low, high))
            self.time_line.refresh()

    def _next_colouring(self) -> None:
        names = list(self.colouring.options)
        self.colouring.value = names[(names.index(self.colouring.value) + 1) % len(names)]

    def _look_through(self) -> None:
        assert self._looking is not None and self.opened.sequence is not None
        names = self.opened.sequence.rig.names
        chosen = self.through.value
        self._looking.choose(names.index(chosen) if chosen in names else None)
        self._choose_layers()

    def _want_voxels(self) -> None:
        if isinstance(self.opened.clouds, CarvedClouds):
            self.opened.clouds.want(bool(self._boxes["voxels"].value))

    def _ask_pictures(self) -> None:
        if self._reader is not None:
            self._reader.ask(self.frame)

    def _show_pictures(self, frame: Frame) -> None:
        sequence = self.opened.sequence
        assert sequence is not None and self._cameras is not None
        if self._closed.is_set():
            return
        names = sequence.rig.names
        view = names.index(self._view.value) if self._view.value in names else None
        self._picture.image = self._draw_picture(frame, view)
        self._cameras.show(small_pictures(frame, sequence.rig))
        if self._looking is not None:
            self._looking.show(frame)

    def _fail(self, text: str) -> None:
        if not self._closed.is_set():
            self.remarks.content = self._describe() + make_lines([("warning", text)])

    def _first_view(self) -> tuple[np.ndarray, np.ndarray]:
        """Return what the viewer looks at first, and from where, (3,) m each."""
        low, high = self.opened.box
        centre = (low + high) / 2
        return centre, centre + float(np.linalg.norm(high - low)) * _VIEWER


class ViewPage(BrowserPage):
    """A page that plays one run.

    open_run: opens it; called with a function that is to be called with the number of each frame
    whose voxels have become known. frame: the first one that is shown, by its number. watch: the
    class of `Watch` that shows it.
    """

    def __init__(
        self,
        open_run: Callable[[Callable[[int], object]], Opened],
        *,
        frame: int | None = None,
        watch: type[Watch] = Watch,
        port: int = 0,
    ) -> None:
        super().__init__("psfs-apf", port)
        self.watch: Watch | None = None
        try:
            opened = open_run(self._show_carved)
            beside = self.add_pictures(watch.beside_label)
            panel = self.server.gui.add_folder("Watch")
            self.watch = watch(self.server, opened, panel, beside)
            if frame is not None:
                self.watch.go_to_frame(frame)
            self.add_dark()
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        """Close the run, and end the server."""
        if self.watch is not None:
            self.watch.close()
        super().stop()

    def _show_carved(self, frame: int) -> None:
        if self.watch is not None:
            self.watch.show_carved(frame)


def draws_slowly(server: viser.ViserServer) -> bool:
    """Ask each browser on the page for a small picture of its scene; return whether one of them
    takes long, as browsers without a graphics chip do. One that is hidden does not count."""
    for client in server.get_clients().values():
        began = time.perf_counter()
        try:
            client.get_render(*_SIZE, timeout=_PATIENCE)
        except (RuntimeError, TimeoutError):  # it was closed, or is hidden
            continue
        if time.perf_counter() - began > _SLOW:
            return True
    return False

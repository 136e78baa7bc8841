"""A take before it is tracked: cameras, pictures with silhouettes, volume, and its faults."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np

from apf.studio.curves import draw_lags
from apf.studio.opened import MakeDevice
from cl import UserError
from psfs.diagnostics.arrangement import Lags
from psfs.diagnostics.config import InViewConfig
from psfs.diagnostics.examination import Examination, examine
from psfs.diagnostics.person_in_view import PersonInView, find_person_in_views
from psfs.diagnostics.sequence_info import UNIT_ASKED, SequenceInfo, sequence_info
from psfs.diagnostics.tangency import Tangency
from psfs.page.nodes import BoxNode, CameraNodes, add_floor
from psfs.page.pictures import PictureReader, blend_silhouette, mosaic, small_pictures
from psfs.page.timeline import TimeLine
from psfs.page.words import make_lines, make_table, make_text
from psfs.sequence import Frame, Sequence
from psfs.session import Session
from psfs.volume import find_volume
from psfs.voxels.grid import VoxelGrid

if TYPE_CHECKING:
    import viser

_MOST_LAG = 30  # frames; longest lag that the curves show
_FLOOR_VOXEL = 0.05  # m; the floor is drawn under a grid


class FootageView:
    """A take on the page, shown until `close`. The arguments are those of `Watch`; make_device:
    makes the device that silhouettes, faults and the volume are computed on."""

    def __init__(
        self,
        server: viser.ViserServer,
        sequence: Sequence,
        panels: tuple[Any, Any],
        make_device: MakeDevice,
    ) -> None:
        self._server, self.sequence, self._make_device = server, sequence, make_device
        self._closed, self._lock = threading.Event(), threading.Lock()
        self._session: Session | None = None
        self._info = sequence_info(sequence)
        self._person: list[PersonInView] = []
        self._frame: Frame | None = None
        self._cameras = CameraNodes(server.scene, sequence.rig)
        self._place(server)
        self._reader = PictureReader(sequence, self._show_pictures, self._warn)
        panel, self._beside = panels
        with panel:
            self._add_controls(server.gui)
        with self._beside:
            self._add_pictures(server.gui)
        self.box = BoxNode(server.scene, "/volume", self._corners, self.drag_box)
        self.time_line.refresh()
        #: It goes on after `close` until the step that it is at has ended.
        self.examiner = threading.Thread(target=self._examine, daemon=True, name="examination")
        self.examiner.start()

    @property
    def remarks(self) -> str:
        """The words about the take, HTML."""
        return str(self._remarks.content)

    @property
    def picture(self) -> np.ndarray:
        """The cameras' pictures as they are shown, (h, w, 3) uint8 RGB."""
        return np.asarray(self._picture.image)

    def show_silhouettes(self, opacity: float) -> None:
        """Draw the silhouettes over the pictures; opacity: 0 to 1."""
        self._opacity.value = opacity
        self._draw_again()

    @property
    def volume(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Lowest and highest corner (3,) m of the volume, if the box on the page is to be used."""
        if not self._own_box.value:
            return None
        low, high = self._corners
        return low, high

    def drag_box(self, corners: np.ndarray) -> None:
        """Use the volume between corners (2, 3) m, to which its handles were dragged."""
        self._own_box.value = True
        self._set_corners(corners)

    @property
    def _corners(self) -> np.ndarray:
        """The lowest and highest corner (2, 3) m of the box on the page."""
        corners = np.array([self._low.value, self._high.value])
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    def close(self) -> None:
        """End all work in the background, and remove everything from the page."""
        self._closed.set()
        self.time_line.close()
        self._reader.close()
        for part in self._parts:
            part.remove()
        self._server.scene.reset()

    def _add_controls(self, gui: viser.GuiApi) -> None:
        count, fps = len(self.sequence), self.sequence.fps
        self._status = gui.add_html("")
        self.time_line = TimeLine(gui, np.arange(max(1, count)), fps, self._show)
        low, high = self._first_box()
        self._own_box: Any = gui.add_checkbox(
            "use this volume",
            False,
            hint="drag its corners; else it is found around what moves",
        )
        self._low: Any = gui.add_vector3("lowest, m", tuple(low.tolist()), step=0.05)
        self._high: Any = gui.add_vector3("highest, m", tuple(high.tolist()), step=0.05)
        for corner in (self._low, self._high):
            corner.on_update(lambda event: self.box.show(self._corners))
        self._notes: list[tuple[str, object]] = [("note", "examining the footage ...")]
        self._remarks = gui.add_html(self._describe())
        self._parts: list[Any] = [self._status, self._own_box, self._low, self._high, self._remarks]

    def _add_pictures(self, gui: viser.GuiApi) -> None:
        self._opacity: Any = gui.add_slider(
            "silhouettes", 0.0, 1.0, 0.05, 0.0, hint="what is taken for the person"
        )
        self._opacity.on_update(lambda event: self._draw_again())
        self._picture = gui.add_image(np.zeros((90, 160, 3), np.uint8), format="jpeg")
        self._parts += [self._opacity, self._picture]

    def _first_box(self) -> tuple[np.ndarray, np.ndarray]:
        stated = self.sequence.volume or self._info.shared
        centre = self._info.centre
        low, high = stated if stated is not None else (centre - 1.0, centre + 1.0)
        return np.round(low, 2), np.round(high, 2)

    def _place(self, server: viser.ViserServer) -> None:
        """Draw the floor, and set the point of view outside of the rig."""
        low, high = self._first_box()
        add_floor(server.scene, VoxelGrid.covering(low, high, _FLOOR_VOXEL))
        size = max(1.0, self._info.extent)
        server.initial_camera.look_at = (low + high) / 2
        server.initial_camera.position = (low + high) / 2 + size * np.array([0.6, -0.9, 0.5])
        server.scene.set_up_direction("+z")

    def _set_corners(self, corners: np.ndarray) -> None:
        """Set the box on the page to corners (2, 3) m."""
        low, high = np.round([corners.min(axis=0), corners.max(axis=0)], 2)
        self._low.value, self._high.value = tuple(low.tolist()), tuple(high.tolist())

    def _show(self, position: int) -> None:
        self._status.content = make_lines(
            [("note", f"frame {position} · {position / self.sequence.fps:.2f} s")]
        )
        self._reader.ask(position)

    def _show_pictures(self, frame: Frame) -> None:
        if self._closed.is_set():
            return
        self._frame = frame
        pictures = small_pictures(frame, self.sequence.rig)
        if self._opacity.value > 0:
            shown = self._silhouettes(frame)
            pictures = [
                blend_silhouette(picture, one, float(self._opacity.value))
                for picture, one in zip(pictures, shown, strict=True)
            ]
        self._cameras.show(pictures)
        self._picture.image = mosaic(pictures)

    def _draw_again(self) -> None:
        if self._frame is not None:
            self._reader.ask(self._frame.index)

    def _silhouettes(self, frame: Frame) -> list[np.ndarray]:
        """Return each camera's silhouette (h, w) bool without the rig's padding."""
        with self._lock:
            evidence = self._make_session().evidence([frame.index])[0]
        sizes = [camera.size for camera in self.sequence.rig]
        return [
            of[:height, :width] > 0 for of, (width, height) in zip(evidence, sizes, strict=True)
        ]

    def _make_session(self) -> Session:
        if self._session is None:
            self._session = Session(self.sequence, self._make_device())
        return self._session

    def _examine(self) -> None:
        """Find the faults of the footage, and the volume."""
        try:
            with self._lock:
                examination = examine(self._make_session())
                warnings = list(examination.warnings)
                faults = [str(fault) for fault in examination.faults if not fault.serious]
                if self._closed.is_set():
                    return
                volume = find_volume(examination.session)
        except UserError as error:
            self._notes = [("warning", error)]
        else:
            if self._closed.is_set():
                return
            known = any(fault.kind in ("unit", "far") for fault in examination.faults)
            self._notes = _list_faults(self._info, known)
            self._notes += [("warning", text) for text in warnings]
            self._notes += [("note", text) for text in faults]
            advice = self._show_person(examination)
            self._notes += [("warning", text) for text in advice]
            if not (warnings or advice or self._info.warnings):
                self._notes.append(("good", "nothing found that speaks against tracking it"))
            if not self._own_box.value:
                self._set_corners(np.stack([volume.low, volume.high]))
        if not self._closed.is_set():
            self._remarks.content = self._describe()

    def _show_person(self, examination: Examination) -> list[str]:
        """Show what each camera sees of the person, and how the cameras are in time; return what to
        do."""
        if examination.diagnosis is None or self.sequence.settings.subject == "object":
            return []
        views = examination.diagnosis.views
        large, small = (max(rig.width, rig.height) for rig in (self.sequence.rig, views.rig))
        self._person = find_person_in_views(views.rig, views.outlines, large / small)
        tangency = Tangency(views.rig, views.outlines)
        if np.isfinite(tangency.size):
            lags = Lags(tangency, min(_MOST_LAG, len(views.frames) // 3))
            costs = [lags.curve(view, [0] * len(views.rig)) for view in range(len(views.rig))]
            figure = draw_lags(np.stack(costs), views.rig.names)
            with self._beside:
                self._parts.append(self._server.gui.add_plotly(figure, aspect=0.8))
        config = InViewConfig()
        return [text for seen in self._person if (text := seen.describe(config))]

    def _warn(self, text: str) -> None:
        self._notes.append(("warning", text))
        self._remarks.content = self._describe()

    def _describe(self) -> str:
        info = self._info
        rows: list[tuple[object, ...]] = [
            (c.name, f"{c.size[0]} x {c.size[1]}", f"{c.distance:.2f}", f"{c.height:.2f}")
            for c in info.cameras
        ]
        heading: tuple[str, ...] = ("camera", "px", "m away", "m high")
        if self._person:
            heading += ("whole", "px")
            seen = [(f"{one.seen * one.whole:.0%}", f"{one.height:.0f}") for one in self._person]
            rows = [(*row, *more) for row, more in zip(rows, seen, strict=True)]
        facts = (
            f"{self.sequence.folder.name}: {info.frames} frames at {info.fps:g} per second; "
            f"background: {info.background_kind}"
        )
        table = make_table(rows, heading)
        return make_text(facts) + table + make_lines(self._notes)


def _list_faults(info: SequenceInfo, unit_known: bool) -> list[tuple[str, object]]:
    """Return the lines on a take that are known without its pictures."""
    lines: list[tuple[str, object]] = [("note", note) for note in info.notes]
    if info.keypoints is not None:
        lines.append(("note", f"keypoints of a pose network: {info.keypoints.name}"))
    texts = [text for text in info.warnings if not (unit_known and UNIT_ASKED in text)]
    return [*lines, *(("warning", text) for text in texts)]

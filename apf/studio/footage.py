"""A take before it is tracked: cameras, pictures with silhouettes, volume, and its faults."""

from __future__ import annotations

import threading
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from apf.studio.opened import MakeDevice
from apf.studio.watch import draw_lags
from cl import UserError
from psfs.diagnostics.examination import Examination, examine
from psfs.diagnostics.person_in_view import PersonInView, find_person_in_views
from psfs.diagnostics.sequence_info import UNIT_ASKED, SequenceInfo
from psfs.diagnostics.tangency import Tangency
from psfs.page.clouds import Opened
from psfs.page.nodes import BoxNode, box_around
from psfs.page.pictures import blend_silhouette, mosaic, small_pictures
from psfs.page.watch import Watch
from psfs.page.words import make_lines, make_table, make_text
from psfs.sequence import Frame, Sequence
from psfs.session import Session
from psfs.volume import find_volume

if TYPE_CHECKING:
    import viser

_MOST_LAG = 30  # frames; longest lag that the curves show
#: Position of a viewer of a rig relative to its middle, times its extent.
VIEWER = np.array([0.6, -0.9, 0.5])


class FootageView(Watch):
    """A take on the page, shown until `close`. make_device: makes the device that silhouettes,
    faults and the volume are computed on. Other arguments as those of `Watch`."""

    layers = ("cameras",)

    def __init__(
        self,
        server: viser.ViserServer,
        sequence: Sequence,
        panels: tuple[Any, Any],
        make_device: MakeDevice,
    ) -> None:
        self.sequence, self._make_device = sequence, make_device
        self._lock = threading.Lock()
        self._person: list[PersonInView] = []
        self._notes: list[tuple[str, object]] = [("note", "examining the footage ...")]
        self._beside, frames = panels[1], np.arange(max(1, len(sequence)))
        self._info = info = SequenceInfo(sequence)
        low, high = sequence.volume or info.shared or box_around(info.centre)
        box = np.round(low, 2), np.round(high, 2)
        opened = Opened(sequence.folder, frames, sequence.fps, box, sequence, None)
        super().__init__(server, opened, *panels)
        self.box = BoxNode(server.scene, "/volume", self._corners, self.drag_box)
        #: It goes on after `close` until the step that it is at has ended.
        self.examiner = threading.Thread(target=self._examine, daemon=True, name="examination")
        self.examiner.start()

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

    def _add_controls(self, gui: viser.GuiApi) -> None:
        super()._add_controls(gui)
        low, high = self.opened.box
        self._own_box: Any = gui.add_checkbox(
            "use this volume",
            False,
            hint="drag its corners; else it is found around what moves",
        )
        self._low: Any = gui.add_vector3("lowest, m", tuple(low.tolist()), step=0.05)
        self._high: Any = gui.add_vector3("highest, m", tuple(high.tolist()), step=0.05)
        for corner in (self._low, self._high):
            corner.on_update(lambda event: self.box.show(self._corners))
        self._parts += [self._own_box, self._low, self._high]

    def _add_pictures(self, gui: viser.GuiApi) -> None:
        self._opacity: Any = gui.add_slider(
            "silhouettes", 0.0, 1.0, 0.05, 0.0, hint="what is taken for the person"
        )
        self._opacity.on_update(lambda event: self._ask_pictures())
        self._parts.append(self._opacity)
        super()._add_pictures(gui)

    def _first_view(self) -> tuple[np.ndarray, np.ndarray]:
        centre = np.mean(self.opened.box, axis=0)
        return centre, centre + max(1.0, self._info.extent) * VIEWER

    def _set_corners(self, corners: np.ndarray) -> None:
        """Set the box on the page to corners (2, 3) m."""
        low, high = np.round([corners.min(axis=0), corners.max(axis=0)], 2)
        self._low.value, self._high.value = tuple(low.tolist()), tuple(high.tolist())

    def _draw_picture(self, frame: Frame, view: int | None) -> np.ndarray:
        if self._opacity.value == 0:
            return super()._draw_picture(frame, view)
        pictures = [
            blend_silhouette(picture, one, float(self._opacity.value))
            for picture, one in zip(
                small_pictures(frame, self.sequence.rig), self._silhouettes(frame), strict=True
            )
        ]
        return mosaic(pictures if view is None else pictures[view : view + 1])

    def _silhouettes(self, frame: Frame) -> list[np.ndarray]:
        """Return each camera's silhouette (h, w) bool without the rig's padding."""
        with self._lock:
            evidence = self._session.evidence([frame.index])[0]
        sizes = [camera.size for camera in self.sequence.rig]
        return [
            of[:height, :width] > 0 for of, (width, height) in zip(evidence, sizes, strict=True)
        ]

    @cached_property
    def _session(self) -> Session:
        return Session(self.sequence, self._make_device())

    def _examine(self) -> None:
        """Find the faults of the footage, and the volume."""
        try:
            with self._lock:
                examination = examine(self._session)
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
            known = any(fault.kind in ("unit", "calibration") for fault in examination.faults)
            self._notes = _list_faults(self._info, self.sequence.notes, known)
            self._notes += [("warning", text) for text in warnings]
            self._notes += [("note", text) for text in faults]
            advice = self._show_person(examination)
            self._notes += [("warning", text) for text in advice]
            if not (warnings or advice or self._info.warnings):
                self._notes.append(("good", "no problems found"))
            if not self._own_box.value:
                self._set_corners(np.stack([volume.low, volume.high]))
        if not self._closed.is_set():
            self.remarks.content = self._describe()

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
            costs = tangency.measure_offset_costs(min(_MOST_LAG, len(views.frames) // 3))
            figure = draw_lags(costs, views.rig.names)
            with self._beside:
                self._parts.append(self._server.gui.add_plotly(figure, aspect=0.8))
        return [text for seen in self._person if (text := seen.describe())]

    def _describe(self) -> str:
        rig = self.sequence.rig
        rows: list[tuple[object, ...]] = [
            (camera.name, f"{distance:.2f}", f"{camera.centre[2]:.2f}")
            for camera, distance in zip(rig, self._info.distances, strict=True)
        ]
        sizes = sorted({f"{c.size[0]} x {c.size[1]}" for c in rig})
        heading: tuple[str, ...] = ("camera", "distance, m", "height, m")
        if self._person:
            heading += ("whole", "person, px")
            seen = [(f"{one.seen * one.whole:.0%}", f"{one.height:.0f}") for one in self._person]
            rows = [(*row, *more) for row, more in zip(rows, seen, strict=True)]
        facts = (
            f"{self.sequence.folder.name}: {len(self.sequence)} frames of {' and '.join(sizes)} "
            f"at {self.sequence.fps:g} per second; background: {self.sequence.background_kind}"
        )
        table = make_table(rows, heading)
        return make_text(facts) + table + make_lines(self._notes)


def _list_faults(
    info: SequenceInfo, notes: list[str], unit_known: bool
) -> list[tuple[str, object]]:
    """Return the lines on a take that are known without its pictures."""
    lines: list[tuple[str, object]] = [("note", note) for note in notes]
    if info.keypoints is not None:
        lines.append(("note", f"keypoints of a pose network: {info.keypoints.name}"))
    texts = [text for text in info.warnings if not (unit_known and UNIT_ASKED in text)]
    return [*lines, *(("warning", text) for text in texts)]

"""Footage without a calibration: the target that its pictures show, and what is missing."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from apf.studio.footage import VIEWER
from apf.studio.target_fields import PERSON, TargetFields
from apf.studio.work import Work, WorkSlot, free_folder
from cl import UserError
from psfs.calibration.targets.detection import (
    find_sightings,
    median_pictures,
    open_uncalibrated,
)
from psfs.cameras.calibration import read_calibration
from psfs.common.requests import Stated
from psfs.diagnostics.sequence_info import rig_extent
from psfs.footage.settings import SequenceSettings
from psfs.page.nodes import CameraNodes, add_floor, box_around
from psfs.page.pictures import PictureReader, mosaic, small_pictures
from psfs.page.server import look
from psfs.page.timeline import TimeLine, add_button, add_key
from psfs.page.words import classify, make_lines, make_text
from psfs.request import CALIBRATION, MOST_TARGET_FRAMES, CalibrateRequest, frame_range
from psfs.sequence import Frame

if TYPE_CHECKING:
    import viser

_NONE = "(none)"


class CalibrateView:
    """A folder of views on the page, shown until `close`.

    panels: as of `Watch`. results: folder for the calibration. known: calibrations by name. use:
    opens the folder with the cameras of a calibration. Raises InputError.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        folder: Path,
        panels: tuple[Any, Any],
        results: Path,
        known: Mapping[str, Path],
        use: Callable[[Path], None],
    ) -> None:
        self.views = open_uncalibrated(folder, SequenceSettings())
        self._server, self._results, self._known, self._use = server, results, dict(known), use
        self._stopped = threading.Event()
        self._worker: threading.Thread | None = None
        self._notes: list[tuple[str, object]] = []
        add_floor(server.scene, box_around(np.zeros(3)))
        server.scene.set_up_direction("+z")
        self._reader = PictureReader(self.views, self._show_pictures, self._say)
        panel, beside = panels
        with beside:
            self._picture = server.gui.add_image(np.zeros((90, 160, 3), np.uint8), format="jpeg")
        with panel:
            self._add_controls(server.gui)
        self.time_line.refresh()

    def _add_controls(self, gui: viser.GuiApi) -> None:
        self._status = gui.add_html("")
        self.time_line = TimeLine(gui, np.arange(len(self.views)), self.views.fps, self._show)
        with gui.add_folder("use known cameras", visible=bool(self._known)) as self._use_folder:
            self.cameras: Any = gui.add_dropdown(
                "calibration", (_NONE, *self._known), initial_value=_NONE
            )
            self.use_button = add_button(gui, "use these cameras", self.use, disabled=True)
        self.slot = WorkSlot(gui)
        self.words: Any = gui.add_html("")
        with gui.add_folder("calibrate the cameras") as calibrate:
            self.target = TargetFields(gui, self._known, self.views.rig, PERSON)
            self.search_button = add_button(gui, "look for the target", self.search, hint="key: F")
            self.floor = gui.add_text(
                "on the floor", "", hint="frame in which it lies there: Z = 0"
            )
            self.floor_button = add_button(
                gui, "the target lies on the floor in this frame",
                lambda: setattr(self.floor, "value", str(self.time_line.position)),
            )  # fmt: skip
            self.calibrate_button = add_button(gui, "calibrate", self.calibrate)
        self.cameras.on_update(
            lambda event: setattr(self.use_button, "disabled", self.cameras.value == _NONE)
        )
        self.target.kind.on_update(lambda event: self._show_fields())
        key = add_key(gui, "Look for the board or wand", "F", self.search)
        self._parts: list[Any] = [
            self._status, self._picture, self._use_folder, calibrate, self.slot, self.words, key,
        ]  # fmt: skip
        self._show_fields()

    def _show_fields(self) -> None:
        """Show what is asked of a target; somebody who walks is no target."""
        for field in (self.search_button, self.floor, self.floor_button):
            field.visible = self.target.searchable

    def use(self) -> None:
        """Open the footage with the cameras that are chosen."""
        if self.cameras.value in self._known:
            self._use(self._known[self.cameras.value])

    def search(self) -> None:
        """Look for the target in all pictures, or in evenly spread ones of long footage."""
        self._stop_search()
        self._stopped = threading.Event()
        self._worker = threading.Thread(
            target=self._search, args=(self._stopped,), daemon=True, name="calibration target"
        )
        self._worker.start()

    def calibrate(self) -> None:
        """Start `psfs calibrate` as the fields say; its cameras are shown when it has ended."""
        self._stop_search()
        try:
            stated = self.target.stated()
            if self.floor.value.strip() and self.target.searchable:
                stated["floor"] = frame_range(self.floor.value.strip())
            stated["folder"] = self.views.folder
            stated["output"] = free_folder(self._results, f"{self.views.folder.name}-cameras")
            request = CalibrateRequest.from_stated(Stated(stated))
            self.slot.start(request, end=self._show_found)
            self._notes, self.calibrate_button.disabled = [], True
            self._tell("")
        except UserError as error:
            self._say(error)

    def close(self) -> None:
        """End all work in the background, and remove everything from the page."""
        self.slot.close()
        self._stop_search()
        self.time_line.close()
        self._reader.close()
        for part in self._parts:
            part.remove()
        self._server.scene.reset()

    def _stop_search(self) -> None:
        self._stopped.set()
        if self._worker is not None:
            self._worker.join(timeout=30)

    def _search(self, stopped: threading.Event) -> None:
        every = range(len(self.views))
        chosen = list(every[:: max(1, -(-len(every) // MOST_TARGET_FRAMES))])
        self._notes = []
        try:
            finder = self.target.make_finder(lambda: median_pictures(self.views, chosen))
            for number, found in enumerate(find_sightings(self.views, chosen, [finder]), 1):
                if stopped.is_set():
                    return
                self.target.add(found)
                self._tell(f"looking: {number} of {len(chosen)} frames")
                if found:
                    self._reader.ask(found[0].frame)
        except UserError as error:
            self._say(error)
            return
        self._tell("looked at all frames")
        self._reader.ask(self.time_line.position)

    def _show_found(self, work: Work) -> None:
        """Show what a calibration has found."""
        self.calibrate_button.disabled = False
        kind = "good" if work.succeeded else "warning"
        self._notes = [classify(line, kind) for line in work.words if not line.startswith("$ ")]
        if work.succeeded:
            file = work.output / CALIBRATION
            rig = read_calibration(file)
            CameraNodes(self._server.scene, rig)
            middle = rig.centres.mean(axis=0)
            look(self._server, middle, middle + rig_extent(rig) * VIEWER)
            self._known[work.output.name] = file
            self.cameras.options = (_NONE, *self._known)
            self.cameras.value, self._use_folder.visible = work.output.name, True
        self._tell("calibrated: use these cameras" if work.succeeded else "not calibrated")

    def _show(self, position: int) -> None:
        seconds = position / self.views.fps
        self._status.content = make_lines([("note", f"frame {position} · {seconds:.2f} s")])
        self._reader.ask(position)

    def _show_pictures(self, frame: Frame) -> None:
        pictures = small_pictures(frame, self.views.rig)
        self.target.mark(pictures, frame.index)
        self._picture.image = mosaic(pictures)

    def _tell(self, doing: str) -> None:
        """Say what is done, found and missing."""
        description = self.target.describe()
        self.words.content = make_text(doing) + description + make_lines(self._notes)

    def _say(self, error: object) -> None:
        self._notes = [("warning", error)]
        self._tell("")

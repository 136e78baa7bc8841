"""Live cameras on the page: the board that they find, the person walking in, recordings."""

from __future__ import annotations

import shutil
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from apf.live.cameras import Captures, average_pictures
from apf.studio.opened import MakeDevice
from apf.studio.target_fields import TargetFields
from apf.studio.work import free_folder
from cl import Device, InputError, NumpyDevice, UserError
from psfs.backend import make_evidence_function
from psfs.calibration.targets.detection import Finder
from psfs.calibration.targets.target import Sighting
from psfs.cameras.calibration import read_calibration
from psfs.cameras.camera import CameraRig
from psfs.common.files import write_picture
from psfs.diagnostics.person_in_view import PersonInView, find_person_in_views
from psfs.diagnostics.small_views import SILHOUETTES, SMALL_SIDE, Outline, Shrink, extract_outline
from psfs.output.preview import label_picture
from psfs.page.pictures import blend_silhouette, fill_view, mosaic, small_pictures
from psfs.page.timeline import add_button, add_key
from psfs.page.words import make_lines, make_table, make_text
from psfs.request import CALIBRATION
from psfs.sequence import Frame

if TYPE_CHECKING:
    import viser

NOTHING, TARGET, PERSON = "nothing", "the board or wand", "the person"
_NONE, _RECORD = "(none)", "record"
#: Least time between two looks, s; pictures of the empty room that are averaged; and by which share
#: of a picture's width a target must have moved to count again.
_PAUSE, _EMPTY, _MOVED = 0.1, 20, 0.02
_OPACITY = 0.6  # of silhouettes
_WIDTH = 480  # px, of a picture on the page
#: Frames that the words on a person are about: the last seconds.
_WINDOW = 30


class FilmView:
    """Live cameras, shown until `close`.

    panels: as of `Watch`. known: calibrations by name. results: folder for recordings. make_device:
    makes the device that silhouettes are computed on. open_folder: opens a recording.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        captures: Captures,
        panels: tuple[Any, Any],
        *,
        known: Mapping[str, Path],
        results: Path,
        make_device: MakeDevice,
        open_folder: Callable[[Path], object],
    ) -> None:
        self._server, self._captures = server, captures
        self._known, self._results = dict(known), results
        self._make_device, self._open_folder = make_device, open_folder
        self.person: PersonCheck | None = None
        self._empty: list[np.ndarray] = []
        self._collecting = False
        self._finder: Finder | None = None
        self._places: dict[int, np.ndarray] = {}  # where a camera last saw the target, px
        #: The recording that goes on: its folder, the cameras' names, and their calibration.
        self._recorded: tuple[Path, list[str], Path | None] | None = None
        self._note: tuple[str, object] = ("note", "Choose what to look for, or record.")
        self._pool = ThreadPoolExecutor(len(captures.rig))
        panel, beside = panels
        with beside:
            self.words: Any = server.gui.add_html("")
        with panel:
            self._add_controls(server.gui)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True, name="filming")
        self._thread.start()

    def _add_controls(self, gui: viser.GuiApi) -> None:
        names = ", ".join(self._captures.rig.names)
        heading = gui.add_html(make_text(f"{names}: {self._captures.fps:g} pictures per second"))
        self.mode: Any = gui.add_dropdown(
            "look for", (NOTHING, TARGET, PERSON), initial_value=NOTHING,
            hint="in the pictures as they come; recorded or not",
        )  # fmt: skip
        self.empty_button = add_button(
            gui, "the room is empty now", self.learn_empty,
            hint="key: M; for two seconds nobody is in any picture",
        )  # fmt: skip
        self.cameras: Any = gui.add_dropdown(
            "cameras of", (_NONE, *self._known), initial_value=_NONE,
            hint="their calibration, for a recording that can be tracked",
        )  # fmt: skip
        self.record_button = add_button(
            gui, _RECORD, self.press_record, hint="key: R; into a new folder"
        )
        with gui.add_folder("the board or wand") as target:
            self.target = TargetFields(gui, self._known, self._captures.rig)
        self.mode.on_update(lambda event: self._restart())
        keys = [
            add_key(gui, "The room is empty now", "M", self.learn_empty),
            add_key(gui, "Begin or end a recording", "R", self.press_record),
        ]
        self._parts: list[Any] = [
            heading, self.mode, self.empty_button, self.cameras, self.record_button, self.words,
            target, *keys,
        ]  # fmt: skip

    def learn_empty(self) -> None:
        """Learn the empty room from the next pictures."""
        self._empty, self._collecting = [], True

    def press_record(self) -> None:
        """Begin a recording, or end it and open its folder."""
        try:
            if self._recorded is None:
                folder, names = free_folder(self._results, "recorded"), self._find_names()
                self._captures.record(folder / "videos", names)
                self._recorded = folder, names, self._known.get(self.cameras.value)
                self.record_button.label = "end the recording"
            else:
                (folder, names, cameras), self._recorded = self._recorded, None
                self.record_button.label = _RECORD
                self._captures.stop_recording()
                self._write_surroundings(folder, names, cameras)
                self._open_folder(folder)
        except (UserError, OSError) as error:
            self._note = "warning", error

    def examine_frame(self, frame: Frame) -> None:
        """Look for what is chosen in a frame, and show it."""
        assert frame.images is not None
        pictures = small_pictures(frame, self._captures.rig, _WIDTH)
        if self._collecting:
            self._empty.append(frame.images)
            if len(self._empty) >= _EMPTY:
                self._collecting = False
                self.person = PersonCheck(self._make_device(), self._captures.rig, self._empty)
                self._note = "good", "the empty room is known; walk in"
        elif self.mode.value == TARGET:
            self._find_target(frame)
            self.target.mark(pictures, frame.index)
        elif self.mode.value == PERSON and self.person is not None:
            masks = self.person.examine_frame(frame)
            pictures = [
                blend_silhouette(picture, mask, _OPACITY)
                for picture, mask in zip(pictures, masks, strict=True)
            ]
        named = zip(pictures, self._captures.rig.names, strict=True)
        fill_view(self._server, mosaic([label_picture(picture, name) for picture, name in named]))
        self._tell()

    def close(self) -> None:
        """End a recording and all work, and remove everything from the page; the cameras go on."""
        self._closed.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=30)
        if self._recorded is not None:
            self._captures.stop_recording()
        self._pool.shutdown()
        fill_view(self._server, None)
        for part in self._parts:
            part.remove()

    def _work(self) -> None:
        shown = -1
        while not self._closed.is_set():
            frame = self._captures.wait(shown)
            if frame is None:
                if self._captures.ended:
                    self._note = "warning", self._captures.ended
                    self._tell()
                    return
                continue
            shown = frame.index
            try:
                self.examine_frame(frame)
            except UserError as error:
                self._note, self.mode.value = ("warning", error), NOTHING
            self._closed.wait(_PAUSE)

    def _restart(self) -> None:
        """Forget what was found, since something else is searched for."""
        self._finder = None
        self._note = "note", f"looking for {self.mode.value}"
        if self.mode.value == PERSON and self.person is None:
            self._note = "warning", "first: nobody in the pictures, and `the room is empty now`"

    def _find_target(self, frame: Frame) -> None:
        rig, pictures = self._captures.rig, self._captures.rig.crop(frame.images)
        if self._finder is None:
            self._finder = self.target.make_finder(self._find_medians)
            self._places = {}
        found = list(self._pool.map(self._finder, range(len(rig)), pictures))
        seen = [Sighting(frame.index, view, *of) for view, of in enumerate(found) if of is not None]
        places = {one.view: one.pixels.mean(axis=0) for one in seen}
        if any(  # it counts again where a camera sees it elsewhere
            view not in self._places
            or np.linalg.norm(place - self._places[view]) > _MOVED * rig[view].size[0]
            for view, place in places.items()
        ):
            self._places |= places
            self.target.add(seen)

    def _find_medians(self) -> list[np.ndarray]:
        """Return each camera's grey picture of the empty room, before which a wand is found."""
        if not self._empty or self._collecting:
            raise InputError("a wand is found before the empty room; expected that it was shown")
        mean = np.rint(average_pictures(self._empty).mean).astype(np.uint8)
        cropped = self._captures.rig.crop(mean)
        return [cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) for picture in cropped]

    def _find_names(self) -> list[str]:
        """Return the names of the recorded cameras: those of the chosen calibration."""
        if self.cameras.value not in self._known:
            return self._captures.rig.names
        names = read_calibration(self._known[self.cameras.value]).names
        if len(names) != len(self._captures.rig):
            raise InputError(
                f"{self.cameras.value} has {len(names)} cameras; expected "
                f"{len(self._captures.rig)}, as many as are filming"
            )
        return names

    def _write_surroundings(self, folder: Path, names: list[str], cameras: Path | None) -> None:
        """Write the calibration and the empty room beside a recording's videos."""
        if cameras is not None:
            shutil.copyfile(cameras, folder / CALIBRATION)
        for number, images in enumerate([] if self._collecting else self._empty):
            cropped = self._captures.rig.crop(images)
            for name, picture in zip(names, cropped, strict=True):
                write_picture(folder / "background" / name / f"{number:03d}.png", picture)

    def _tell(self) -> None:
        """Say what is done, and what of the target, or of the person, was seen."""
        description, line = "", self._note
        if self.mode.value == TARGET:
            description = self.target.describe()
        elif self.mode.value == PERSON and self.person is not None:
            description = self.person.describe()
        if self._collecting:
            line = "note", f"the empty room: {len(self._empty)} of {_EMPTY} pictures"
        elif self._recorded is not None:
            line = "note", f"recording into {self._recorded[0].name}"
        self.words.content = make_lines([line]) + description


class PersonCheck:
    """Silhouettes of live frames before the empty room, and what they say about each camera.

    empty: pictures (V, H, W, 3) uint8 of the empty room, some.
    """

    def __init__(
        self, device: Device | NumpyDevice, rig: CameraRig, empty: Sequence[np.ndarray]
    ) -> None:
        self._shrink = Shrink(rig, rig.factor_within(SMALL_SIDE))
        small = self._shrink.small
        self._evidence_of = make_evidence_function(
            device, small, self._shrink.background(average_pictures(empty)), SILHOUETTES
        )
        self._scale = rig[0].size[0] / small[0].size[0]
        self._outlines: deque[list[Outline | None]] = deque(maxlen=_WINDOW)

    def examine_frame(self, frame: Frame) -> list[np.ndarray]:
        """Return each camera's silhouette (h, w) bool of a frame, in small pictures."""
        evidence, small = self._evidence_of(self._shrink.frame(frame)), self._shrink.small
        masks = [counts > 0 for counts in small.crop(evidence)]
        self._outlines.append([extract_outline(mask) for mask in masks])
        return masks

    @property
    def views(self) -> list[PersonInView]:
        """The cameras' views of the person in the last frames."""
        return find_person_in_views(self._shrink.small, list(self._outlines), self._scale)

    def describe(self) -> str:
        """Return what each camera sees and what to do, HTML."""
        if not any(one.seen for one in self.views):
            return make_lines([("note", "nobody is seen yet")])
        rows = [
            (one.camera, f"{one.seen:.0%}", f"{one.seen * one.whole:.0%}", f"{one.height:.0f}")
            for one in self.views
        ]
        advice: list[tuple[str, object]] = [
            ("warning", text) for one in self.views if (text := one.describe())
        ]
        lines = advice or [("good", "every camera sees the whole person")]
        return make_table(rows, ("camera", "seen", "whole", "px high")) + make_lines(lines)

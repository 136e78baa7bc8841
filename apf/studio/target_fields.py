"""The fields that say what cameras are calibrated by, with their flags and detectors, and what the
cameras have seen of that target so far, drawn and in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from cl import InputError
from psfs.calibration.report import CELLS, Coverage, measure_coverage
from psfs.calibration.targets.detection import Finder
from psfs.calibration.targets.markers import MarkerFinder
from psfs.calibration.targets.target import Sighting, make_wand
from psfs.cameras.camera import CameraRig
from psfs.cli.calibrate import make_board_finders
from psfs.common.files import temporary_folder
from psfs.common.requests import Stated
from psfs.page.server import read_choice, read_metres
from psfs.page.words import make_lines, make_table, make_text
from psfs.request import CalibrateRequest

if TYPE_CHECKING:
    import viser

#: RGB of found points, and how much darker parts of pictures without any are.
_POINT, _SHADE = (0, 230, 120), 0.45


CHARUCO, CHESSBOARD, WAND, PERSON = "ChArUco board", "chessboard", "wand", "somebody who walks"
_BOARDS = {CHARUCO: "charuco", CHESSBOARD: "chessboard"}
_NONE = "not known"
#: A marker's side as a share of its square's.
_MARKER = 0.75


class TargetFields:
    """The fields, in the current folder of `gui`, and the sightings of the target by the cameras of
    `rig`. lenses: calibrations by the names that are offered. kind: of the target, at first."""

    def __init__(
        self, gui: viser.GuiApi, lenses: Mapping[str, Path], rig: CameraRig, kind: str = CHARUCO
    ) -> None:
        self._lenses, self._rig = lenses, rig
        self._name = "target"
        self.sightings: list[Sighting] = []
        self.coverage: list[Coverage] = []
        self.kind = gui.add_dropdown(
            "by", (CHARUCO, CHESSBOARD, WAND, PERSON), initial_value=kind,
            hint="what is filmed by all cameras at once",
        )  # fmt: skip
        self.squares: Any = gui.add_vector2(
            "squares", (7, 5), min=(3, 3), max=(100, 100), step=1,
            hint="columns and rows of the board; not its inner corners",
        )  # fmt: skip
        self.square = gui.add_number("square, m", 0.037, min=0.001, max=2.0, step=0.001)
        self.wand = gui.add_text(
            "wand, m", "0.5", hint="from each marker to the next: 0.5, or 0.2,0.3"
        )
        self.stature = gui.add_number("person's height, m", 1.7, min=0.3, max=3.0, step=0.01)
        self.intrinsics: Any = gui.add_dropdown(
            "lenses", (_NONE, *lenses), initial_value=_NONE, hint="those of another calibration"
        )
        self.field_of_view = gui.add_number(
            "field of view, degrees", 65.0, min=0.0, max=179.0, step=1.0,
            hint="of the pictures' longer side: phones about 65; 0: as the videos state it",
        )  # fmt: skip
        self.sound = gui.add_checkbox(
            "shift by sound", False, hint="cameras began apart; one loud clap is in all videos"
        )
        self.board = gui.add_button("a board to print", hint="a PDF of the board above")
        self.board.on_click(lambda event: self._send_board(event.client))
        self._problem = gui.add_html("")
        for field in (self.kind, self.intrinsics):
            field.on_update(lambda event: self._show_fields())
        self._show_fields()

    @property
    def searchable(self) -> bool:
        """Whether pictures are searched for the target before the calibration."""
        return self.kind.value != PERSON

    @property
    def lenses_known(self) -> bool:
        """Whether the lenses of another calibration are used, so that only the cameras' places are
        to be found."""
        return self.intrinsics.value != _NONE

    def make_finder(self, find_medians: Callable[[], list[np.ndarray]]) -> Finder:
        """Return the detector of the target, and forget all sightings. find_medians: returns each
        camera's grey picture (h, w) uint8 without what moves, for a wand. Raises InputError."""
        request = CalibrateRequest.from_stated(Stated(self.stated()))
        finder: Finder = next(iter(make_board_finders(request)), None) or MarkerFinder(
            make_wand(request.wand or ()), find_medians()
        )
        self._name, self.sightings, self.coverage = finder.target.name, [], []
        return finder

    def add(self, found: Sequence[Sighting]) -> None:
        """Add the sightings of a frame."""
        self.sightings = [*self.sightings, *found]
        self.coverage = measure_coverage(list(self._rig), self.sightings)

    def mark(self, pictures: Sequence[np.ndarray], frame: int) -> None:
        """Draw the found points over pictures (h, w, 3) uint8 RGB, one per camera: those of a
        frame, by its number, larger; and darken the parts in which nothing was found."""
        for view, (picture, camera) in enumerate(zip(pictures, self._rig, strict=True)):
            if self.coverage:
                sides = zip(picture.shape, CELLS[::-1], strict=False)
                cells = np.ix_(*(np.arange(side) * count // side for side, count in sides))
                dark = ~self.coverage[view].cells[cells]
                picture[dark] = (_SHADE * picture[dark]).astype(np.uint8)
            scale = picture.shape[1] / camera.size[0]
            for sighting in self.sightings:
                if sighting.view == view:
                    size = 3 if sighting.frame == frame else 1
                    for x, y in np.rint(scale * sighting.pixels).astype(int).tolist():
                        cv2.circle(picture, (x, y), size, _POINT, -1)

    def describe(self) -> str:
        """Return what is found and what is missing, HTML."""
        rows, gaps = [], list[tuple[str, object]]()
        for camera, seen in zip(self._rig, self.coverage, strict=False):
            rows.append((camera.name, seen.frames, seen.shared, f"{seen.share:.0%}"))
            missing = seen.list_gaps(self._name, self.lenses_known)
            gaps += [("warning", f"{camera.name} {text}") for text in missing]
        if not rows:
            return ""
        heading = ("camera", "frames", "shared", "covered")
        return make_table(rows, heading) + make_lines(
            gaps or [("good", "every camera has seen enough")]
        )

    def stated(self) -> dict[str, Any]:
        """Return what the fields state for a `CalibrateRequest`. Raises InputError."""
        kind = read_choice(self.kind)
        if kind == PERSON:
            values: dict[str, Any] = {"person": True, "stature": self.stature.value}
            if not self.lenses_known and self.field_of_view.value > 0:
                values["field_of_view"] = self.field_of_view.value
        elif kind == WAND:
            values = {"wand": tuple(read_metres(self.wand, "wand's length"))}
        else:
            values = {"board": _BOARDS[kind], "squares": self._squares()}
            values["square"] = float(self.square.value)
        if self.lenses_known:
            values["intrinsics"] = self._lenses[read_choice(self.intrinsics)]
        return values | ({"sync": "audio"} if self.sound.value and kind != PERSON else {})

    def make_board(self) -> tuple[str, bytes]:
        """Return name and content of the PDF of the board. Raises InputError."""
        from psfs.calibration.targets.print_board import write_board_pdf  # loads Matplotlib

        columns, rows = self._squares()
        square = float(self.square.value)
        with temporary_folder() as folder:
            path = folder / "board.pdf"
            write_board_pdf(path, (columns, rows), (square, _MARKER * square), "4X4")
            return f"board_{columns}x{rows}_{1000 * square:g}mm.pdf", path.read_bytes()

    def _squares(self) -> tuple[int, int]:
        columns, rows = self.squares.value
        return int(columns), int(rows)

    def _show_fields(self) -> None:
        """Show the fields that the kind of target has."""
        kind = self.kind.value
        self.squares.visible = self.square.visible = kind in _BOARDS
        self.board.visible = kind == CHARUCO
        self.wand.visible, self.stature.visible = kind == WAND, kind == PERSON
        self.field_of_view.visible = kind == PERSON and not self.lenses_known
        self.sound.visible = kind != PERSON

    def _send_board(self, client: viser.ClientHandle | None) -> None:
        if client is None:
            return
        try:
            name, content = self.make_board()
        except InputError as error:
            self._problem.content = make_text(error)
            return
        client.send_file_download(name, content, save_immediately=True)

"""The page: its panels, and the folder that is open in it."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apf.live.cameras import Captures
from apf.request import SynthRequest
from apf.studio.calibrate import CalibrateView
from apf.studio.correct_panel import CorrectPanel
from apf.studio.export_panel import ExportPanel
from apf.studio.film import FilmView
from apf.studio.folders import Roots, find_kind
from apf.studio.footage import FootageView
from apf.studio.opened import MakeDevice, open_track
from apf.studio.run_panel import RunPanel
from apf.studio.watch import TrackWatch
from apf.studio.work import Work, WorkSlot, free_folder
from cl import InputError, UserError
from psfs.cli.program import describe
from psfs.common.files import read_json
from psfs.page.clouds import open_voxels
from psfs.page.drop import receive_files
from psfs.page.server import BrowserPage
from psfs.page.timeline import add_button
from psfs.page.watch import Watch
from psfs.page.words import make_lines, make_steps, make_text
from psfs.request import parse_sync
from psfs.sequence import Sequence

if TYPE_CHECKING:
    import viser

#: Kinds of folders, as the list names them.
_KINDS = {
    "take": "footage",
    "views": "footage without cameras",
    "track": "track",
    "voxels": "voxels",
}
_NOTHING, _LIVE = "(choose)", "the cameras, live"
#: The way from footage to a file, and what to do at each of its steps.
_STEPS = {
    "Open": "Drop videos onto the page, choose a folder of videos or results, or make a demo walk.",
    "Calibrate": "Choose what all cameras have filmed; calibrate; then use these cameras.",
    "Track": "At the left, raise silhouettes: do they show the person? Then tab Track: track.",
    "Check": "Press play; N goes to the next frame to check. Then tab Save.",
    "Save": "The files are among the browser's downloads.",
}


class Page(BrowserPage):
    """The page on a server of its own. roots: the folders that may be opened. make_device: makes
    the device for work on pictures; device: the flag that names it. results: the folder for runs.
    port: see `start_server`. captures: live cameras; they are closed with the page."""

    def __init__(
        self,
        roots: Roots,
        make_device: MakeDevice,
        port: int = 0,
        *,
        results: Path = Path("results"),
        device: str = "auto",
        captures: Captures | None = None,
    ) -> None:
        self.roots, self._make_device, self._results = roots, make_device, results
        self._device, self._stopping = device, False
        super().__init__("psfs-apf studio", port, self._receive)
        self._lock = threading.RLock()
        #: What is open: a folder, or the live cameras.
        self.view: Watch | CalibrateView | FilmView | None = None
        self._examiners: list[threading.Thread] = []
        self._captures = captures
        gui = self.server.gui
        self.pictures = self.add_pictures(TrackWatch.beside_label)
        self._steps: Any = gui.add_html("")
        self._add_open(gui)
        self._line: Any = gui.add_folder("time line", visible=False)  # in sight in every tab
        with self._line:  # never empty: viser folds such a folder, and unfolds it too low
            gui.add_html("")
        tabs = gui.add_tab_group()
        self.watching, running = tabs.add_tab("Watch"), tabs.add_tab("Track")
        self._empty: list[Any] = []
        for panel in (self.watching, self.pictures):
            with panel:
                self._empty.append(gui.add_html(make_text("What you open is shown here.")))
        with running:
            self.run = RunPanel(gui, results, device, self._show_run, self.say)
        with tabs.add_tab("Correct"):
            self.correct = CorrectPanel(self.server, self.run.start, self.say)
        with tabs.add_tab("Save"):
            self.export = ExportPanel(gui, self.say, lambda: self._show_step("Save"))
        self._show_step("Open")

    def list_folders(self) -> None:
        """Offer the folders that can be opened, found again."""
        found = self.roots.find()
        self._choices = {f"{one.name} ({_KINDS[one.kind]})": one for one in found}
        live = [_LIVE] if self._captures is not None else []
        self._folder.options = [_NOTHING, *live, *self._choices]

    def open(self, path: Path) -> None:
        """Open a folder in place of the one that is open. Raises UserError, after which nothing is
        open; InputError for a folder outside of the roots."""
        with self._lock:
            path = self.roots.check(path)
            kind = find_kind(path)
            if self._results.is_dir():
                self.roots.add(self._results)
            self._make_room()
            self._choose_in_list(path)
            server, panels = self.server, (self.watching, self.pictures)
            self._line.visible = kind in ("track", "voxels")
            if kind == "track":
                running = self.run.find_running(path)
                opened = open_track(path, self._make_device, self._show_carved, running)
                self.view = TrackWatch(server, opened, *panels, self._line)
                self._offer()
                if running is None:
                    verdict = [
                        f"{line[:1].upper()}{line.partition(';')[0][1:]}."
                        for line in opened.quality[:1]
                    ]
                    self._show_step("Check", " ".join([*verdict, _STEPS["Check"]]))
                else:
                    self._show_step("Track", "The track so far; tab Track says how far it is.")
            elif kind == "voxels":
                self.view = Watch(server, open_voxels(path), *panels, self._line)
            elif kind == "take":
                self._open_footage(Sequence.open(path))
            elif kind == "views":
                known = self.roots.find_calibrations()
                self.view = CalibrateView(
                    server, path, panels, self._results, known,
                    lambda cameras: self._open_with_cameras(path, cameras),
                )  # fmt: skip
                self._show_step("Calibrate")
            else:
                raise InputError(
                    f"{path}: nothing to open; expected a take, or results of apf track or psfs "
                    "reconstruct"
                )

    def open_cameras(self) -> None:
        """Show the live cameras in place of the folder that is open."""
        with self._lock:
            assert self._captures is not None
            self._make_room()
            self._opened = self._folder.value = _LIVE
            self.view = FilmView(
                self.server, self._captures, (self.watching, self.pictures),
                known=self.roots.find_calibrations(), results=self._results,
                make_device=self._make_device, open_folder=self._show_run,
            )  # fmt: skip
            self._show_step("Open", "Look for the board, or the person, and record: it opens.")

    def close_folder(self) -> None:
        """Close the folder that is open, if one is."""
        with self._lock:
            self.correct.offer(None)  # its handle stands in the scene
            if isinstance(self.view, FootageView):
                self._examiners.append(self.view.examiner)
            if self.view is not None:
                self.view.close()
            self.view = None
            self._line.visible = False
            self._offer()
            for note in self._empty:
                note.visible = True
            self._show_step("Open")

    def _make_room(self) -> None:
        """Close the folder that is open, and hide what the page says while none is."""
        self.close_folder()
        self._message.content = ""
        for note in (self.demo_button, *self._empty):
            note.visible = False

    def _open_footage(self, sequence: Sequence) -> None:
        panels = self.watching, self.pictures
        self.view = footage = FootageView(self.server, sequence, panels, self._make_device)
        self.run.offer(sequence, lambda: footage.volume)
        self._show_step("Track")

    def _open_with_cameras(self, path: Path, cameras: Path) -> None:
        """Open footage without a calibration with the cameras of a file."""
        with self._lock:
            try:
                sequence = Sequence.open(path, calibration=cameras, **_read_times(cameras))
            except UserError as error:
                self.say(error)
                return
            self._make_room()
            self._open_footage(sequence)

    def _choose_in_list(self, path: Path) -> None:
        """Have the list of folders show which one is open."""
        if not any(one.path.resolve() == path for one in self._choices.values()):
            self.list_folders()
        names = [name for name, one in self._choices.items() if one.path.resolve() == path]
        self._opened = names[0] if names else _NOTHING
        self._folder.value = self._opened

    def _show_step(self, step: str, words: str = "") -> None:
        """Show where on the way from footage to a file one is, and what to do next."""
        self.step = step
        self._steps.content = make_steps(list(_STEPS), step) + make_text(words or _STEPS[step])

    def _offer(self) -> None:
        """Have the panels offer what can be done with the run that is open, or nothing."""
        tracked = self.view if isinstance(self.view, TrackWatch) else None
        self.correct.offer(tracked)
        self.export.offer(tracked)
        if not isinstance(self.view, FootageView):
            self.run.offer(None)

    def stop(self) -> None:
        """Close everything, and end the server. Drivers abort a process that ends while one of its
        threads computes."""
        self._stopping = True
        self.run.close()
        self._demo.close()
        self.close_folder()
        if self._captures is not None:
            self._captures.close()
        super().stop()
        for examiner in self._examiners:
            examiner.join(timeout=60)

    def make_demo(self) -> None:
        """Make the walk of `apf demo` in a folder of the results, and open it."""
        output = free_folder(self._results, "demo")
        try:
            request = SynthRequest(output=output, device=self._device)
            self._demo.start(request, end=self._show_demo)
        except UserError as error:
            self.say(error)

    def _show_demo(self, work: Work) -> None:
        if work.succeeded:
            self._show_run(work.output)
        else:
            self.say("; ".join(work.words))

    def say(self, error: object) -> None:
        """Show an error on the page."""
        words = describe(error) if isinstance(error, BaseException) else error
        self._message.content = make_lines([("warning", words)])

    def _add_open(self, gui: viser.GuiApi) -> None:
        self._folder: Any = gui.add_dropdown(
            "open",
            [_NOTHING],
            initial_value=_NOTHING,
            hint="takes and results in the folders of the command",
        )
        self._opened = _NOTHING
        self._message: Any = gui.add_html("")
        self._demo = WorkSlot(gui)
        add_button(gui, "look for new folders", self.list_folders, color="gray")
        self.demo_button = add_button(
            gui, "demo walk", self.make_demo,
            hint="makes a synthetic walker before four cameras (apf synth), and opens it",
        )  # fmt: skip
        self.list_folders()
        self._folder.on_update(lambda event: self._choose())
        self.add_dark()

    def _choose(self) -> None:
        found, chosen = self._choices.get(self._folder.value), self._folder.value
        if chosen == self._opened or (found is None and chosen != _LIVE):
            return
        try:
            if found is None:
                self.open_cameras()
            else:
                self.open(found.path)
        except UserError as error:
            self.say(error)

    def _show_run(self, output: Path) -> None:
        """Open a run that was started here, and list it."""
        if self._stopping:
            return
        self.roots.add(output)
        watch, with_voxels = self.view, False
        if isinstance(watch, TrackWatch) and watch.opened.folder.resolve() == output.resolve():
            with_voxels = watch.shown["voxels"]
        try:
            self.open(output)
            if with_voxels and isinstance(self.view, TrackWatch):
                self.view.show_layer("voxels")
        except UserError as error:  # its first part is just being replaced
            self.say(error)

    async def _receive(self, connection: Any) -> None:
        """Take the files that are dropped onto the page into a folder of the results, and open it
        in a thread of its own: viser's answers the browser."""

        def show(folder: Path) -> None:
            threading.Thread(target=self._show_run, args=(folder,), daemon=True).start()

        await receive_files(connection, lambda: free_folder(self._results, "dropped"), show)

    def _show_carved(self, frame: int) -> None:
        if isinstance(watch := self.view, TrackWatch):
            watch.show_carved(frame)


def _read_times(cameras: Path) -> dict[str, Any]:
    """Return how late the cameras of a calibration by a person are, as the setting `sync`; nothing
    for other calibrations."""
    report = cameras.with_suffix(".json")
    late = read_json(report, "a report").get("sync") if report.is_file() else None
    return {"sync": parse_sync(late)} if isinstance(late, str) else {}

"""The panel that exports results: files of motion, smoothed or as tracked, and the report."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apf.formats.writers import BODY_WRITERS, WRITERS
from apf.report import PAGE
from apf.studio.watch import TrackWatch
from apf.tracking.smoothing import smooth_track
from apf.tracking.track import Track
from cl import UserError
from psfs.common.files import temporary_folder
from psfs.page.server import read_choice
from psfs.page.words import make_text

if TYPE_CHECKING:
    import viser

#: Endings of the files that a track is written as, those of a moving body first.
ENDINGS = (*BODY_WRITERS, *WRITERS, ".trc", ".npz")


class ExportPanel:
    """The panel. say: shows an error on the page; saved: called after a file was sent."""

    def __init__(
        self,
        gui: viser.GuiApi,
        say: Callable[[object], object],
        saved: Callable[[], object] = lambda: None,
    ) -> None:
        self._say, self._saved = say, saved
        self._watch: TrackWatch | None = None
        self._message = gui.add_html(make_text("Open a track to export it."))
        self.person: Any = gui.add_dropdown("person", ["-"], initial_value="-", visible=False)
        self.ending = gui.add_dropdown("file", list(dict.fromkeys(ENDINGS)), initial_value=".bvh")
        self.smooth = gui.add_checkbox("smoothed", True, hint="as apf smooth does")
        self.button = gui.add_button("save", disabled=True)
        self.report = gui.add_button("save the report", disabled=True, color="gray")
        self.button.on_click(lambda event: self._send(event.client, self.make_file))
        self.report.on_click(lambda event: self._send(event.client, self.read_report))

    def offer(self, watch: TrackWatch | None) -> None:
        """Offer the tracks of what is watched; None offers nothing."""
        self._watch = watch
        tracks = list(watch.opened.tracks) if watch is not None else []
        self.button.disabled = not tracks
        self.person.visible = len(tracks) > 1
        self.person.options = tracks or ["-"]
        self.person.value = tracks[0] if tracks else "-"
        self.report.disabled = watch is None or not (watch.opened.folder / PAGE).is_file()
        whose = tracks[0] if len(tracks) == 1 else "one of the people"
        words = f"Choose a file of {whose}." if tracks else "Open a track to export it."
        self._message.content = make_text(words)

    def make_file(self) -> tuple[str, bytes]:
        """Return name and content of the chosen file, a ZIP of them if the track makes several.
        Raises UserError."""
        assert self._watch is not None
        name, ending = read_choice(self.person), read_choice(self.ending)
        track: Track = self._watch.opened.tracks[name]
        if self.smooth.value and track.smoothing is None and len(track) > 1:
            track = smooth_track(track)
        with temporary_folder() as folder:
            track.save(folder / f"{name}{ending}")
            files = list(folder.iterdir())
            if len(files) == 1:
                return files[0].name, files[0].read_bytes()
            with temporary_folder() as beside:
                packed = shutil.make_archive(str(beside / name), "zip", folder)
                return f"{name}.zip", Path(packed).read_bytes()

    def read_report(self) -> tuple[str, bytes]:
        """Return name and content of the report."""
        assert self._watch is not None
        folder = self._watch.opened.folder
        return f"{folder.name}.html", (folder / PAGE).read_bytes()

    def _send(
        self, client: viser.ClientHandle | None, make: Callable[[], tuple[str, bytes]]
    ) -> None:
        if self._watch is None or client is None:
            return
        try:
            name, content = make()
        except (UserError, OSError) as error:
            self._say(error)
            return
        client.send_file_download(name, content, save_immediately=True)
        self._saved()

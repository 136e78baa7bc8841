"""The page: its panels, and the folder that is open in it."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

from apf.studio.folders import Found, Roots, find_kind
from apf.studio.gate import Gate, page_address, start_server, stop_server
from apf.studio.opened import MakeDevice, Opened, open_track, open_voxels
from apf.studio.watch import Watch
from apf.studio.words import make_lines, make_text
from cl import InputError, UserError

#: Kinds of folders, as the list names them.
_KINDS = {"take": "footage", "track": "track", "voxels": "voxels"}
_NOTHING = "(choose)"


class Page:
    """The page on a server of its own. roots: the folders that may be opened. make_device: makes
    the device for work on pictures. port: see `start_server`."""

    def __init__(self, roots: Roots, make_device: MakeDevice, port: int = 0) -> None:
        self.roots, self._make_device = roots, make_device
        self.gate = Gate()
        self.server = start_server(port, self.gate)
        self._lock = threading.RLock()
        self.watch: Watch | None = None
        gui = self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        gui.set_panel_label("psfs-apf studio")
        self._beside = gui.add_panel()
        self.pictures = self._beside.add_tab("Pictures and curves")
        self._beside.dock_left()
        self._beside.set_width(380)
        gui.main_panel.dock_right()
        self._add_open(gui)
        tabs = gui.add_tab_group()
        self.watching = tabs.add_tab("Watch")
        self.tabs = tabs

    @property
    def address(self) -> str:
        """The page's address, with its token."""
        return page_address(self.server, self.gate)

    def list_folders(self) -> list[Found]:
        """Find the folders that can be opened again, and offer them."""
        found = self.roots.find()
        self._choices = {f"{one.name} ({_KINDS[one.kind]})": one for one in found}
        self._folder.options = [_NOTHING, *self._choices]
        return found

    def open(self, path: Path) -> None:
        """Open a folder in place of the one that is open. Raises UserError, after which nothing is
        open; InputError for a folder outside of the roots."""
        with self._lock:
            path = self.roots.check(path)
            kind = find_kind(path)
            self.close_folder()
            if kind == "track":
                opened = open_track(path, self._make_device, self._show_carved)
            elif kind == "voxels":
                opened = open_voxels(path)
            else:
                raise InputError(
                    f"{path}: nothing to open; expected results of apf track or psfs reconstruct"
                )
            self._watch(opened)
            self._message.content = ""

    def close_folder(self) -> None:
        """Close the folder that is open, if one is."""
        with self._lock:
            if self.watch is not None:
                self.watch.close()
                self.watch = None

    def stop(self) -> None:
        """Close everything, and end the server."""
        self.close_folder()
        stop_server(self.server)

    def say(self, error: object) -> None:
        """Show an error on the page."""
        self._message.content = make_lines([("warning", error)])

    def _add_open(self, gui: Any) -> None:
        self._folder = gui.add_dropdown(
            "open",
            [_NOTHING],
            initial_value=_NOTHING,
            hint="takes and results in the folders of the command",
        )
        self._message = gui.add_html(make_text("Choose a folder to open."))
        self.list_folders()
        self._folder.on_update(lambda event: self._choose())

    def _choose(self) -> None:
        found = self._choices.get(self._folder.value)
        if found is None:
            return
        try:
            self.open(found.path)
        except UserError as error:
            self.say(error)

    def _watch(self, opened: Opened) -> None:
        self.watch = Watch(self.server, opened, self.watching, self.pictures)

    def _show_carved(self, frame: int) -> None:
        if (watch := self.watch) is not None:
            watch.show_carved(frame)

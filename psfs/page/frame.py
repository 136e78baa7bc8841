"""A page on a server of its own: pictures at the left, panels at the right, dark or light."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from psfs.page.gate import Gate, page_address, start_server, stop_server
from psfs.page.opened import Opened
from psfs.page.timeline import add_key
from psfs.page.watch import Watch


class BrowserPage:
    """An empty page. label: above its panels. port: see `start_server`."""

    def __init__(self, label: str, port: int = 0) -> None:
        self.gate = Gate()
        self.server = start_server(port, self.gate)
        gui = self.server.gui
        self._choose_theme(False)
        gui.set_panel_label(label)

    @property
    def address(self) -> str:
        """The page's address, with its token."""
        return page_address(self.server, self.gate)

    def stop(self) -> None:
        """End the server."""
        stop_server(self.server)

    def add_pictures(self, label: str) -> Any:
        """Add a panel for pictures at the left; return its tab."""
        gui = self.server.gui
        beside = gui.add_panel()
        tab = beside.add_tab(label)
        beside.dock_left()
        beside.set_width(380)
        gui.main_panel.dock_right()
        return tab

    def add_dark(self) -> None:
        """Add the choice between dark and light."""
        gui = self.server.gui
        self.dark: Any = gui.add_checkbox("dark", False, hint="key: I")
        self.dark.on_update(lambda event: self._choose_theme(self.dark.value))
        add_key(gui, "Dark or light", "I", lambda: setattr(self.dark, "value", not self.dark.value))

    def _choose_theme(self, dark: bool) -> None:
        self.server.gui.configure_theme(
            dark_mode=dark, show_logo=False, show_share_button=False, control_width="large"
        )


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

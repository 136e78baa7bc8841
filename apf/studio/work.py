"""A command in a process of its own: started, followed by the files it writes, ended."""

from __future__ import annotations

import re
import subprocess
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomli_w

from apf.tracking.track import PARTS, Track
from cl import InputError, UserError
from cl.probe import module_command
from psfs.common.bars import PROGRESS, StatedProgress
from psfs.common.files import temporary_folder
from psfs.common.requests import Request, list_options
from psfs.common.system import PATIENCE
from psfs.footage.memory import store
from psfs.page.timeline import add_button
from psfs.page.words import REFRESH, make_text

if TYPE_CHECKING:
    import viser

#: Characters of progress bars and tables, which the page has in its own way.
_DRAWN = frozenset("━┃│└╇┡")


def free_folder(root: Path, name: str) -> Path:
    """Return a folder in `root` that does not exist yet: of this name, or with a number behind."""
    safe = re.sub(r"[^\w.-]+", "_", name).strip("._") or "run"
    number, path = 1, root / safe
    while path.exists():
        number += 1
        path = root / f"{safe}-{number}"
    return path


class WorkSlot:
    """The place of one command at a time, which several browsers may want to start, and what the
    page shows of it while it goes on: a bar, what it is doing, and a button that cancels it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._lock = threading.Lock()
        self.work: Work | None = None
        self._follower: threading.Thread | None = None
        self.words: Any = gui.add_html("", visible=False)
        self.bar: Any = gui.add_progress_bar(0.0, visible=False)
        self.button = add_button(gui, "cancel", self.cancel, visible=False, color="gray")

    @property
    def busy(self) -> bool:
        """Whether a command goes on."""
        return self.work is not None and not self.work.ended

    def start(
        self,
        request: Request,
        tell: Callable[[Work], object] = lambda work: None,
        end: Callable[[Work], object] = lambda work: None,
    ) -> Work:
        """Start the command of a request, see `Work`. tell: called with it when the page is to be
        told again; end: when it has ended. Raises InputError while another goes on."""

        def follow() -> None:
            while work.wait_for_news():
                self._show(work)
                tell(work)
            self._show(work)
            end(work)

        with self._lock:
            if self.busy:
                raise InputError("a run goes on; expected one at a time (cancel it first)")
            self.work = work = Work(request)
            self._follower = threading.Thread(target=follow, daemon=True, name=request.COMMAND)
            self._follower.start()
        return work

    def wait(self, seconds: float) -> None:
        """Wait until the command has ended and its end was told, at most so long."""
        if self._follower is not None and self._follower is not threading.current_thread():
            self._follower.join(seconds)

    def cancel(self) -> None:
        """Interrupt the command, if one goes on."""
        if self.work is not None:
            self.work.cancel()

    def close(self) -> None:
        """End the command, if one goes on."""
        with self._lock:
            if self.work is not None:
                self.work.close()
        self.wait(PATIENCE)

    def remove(self) -> None:
        """Remove what is shown from the page."""
        for part in (self.words, self.bar, self.button):
            part.remove()

    def _show(self, work: Work) -> None:
        """Show how far a command is."""
        self.words.content, self.bar.value = make_text(work.describe()), 100 * work.share
        for part in (self.words, self.bar, self.button):
            part.visible = not work.ended


class Work:
    """The running command of a request, which states the folder of its results, a new one."""

    def __init__(self, request: Request) -> None:
        self.output = Path(getattr(request, "output", "."))
        self._files = ExitStack()
        program, subcommand = request.COMMAND.split()
        words = [subcommand, *state_flags(request)]
        folder = self._files.enter_context(temporary_folder())
        if tables := request.stated.tables:
            settings = folder / "settings.toml"
            settings.write_text(tomli_w.dumps(dict(tables)), encoding="utf-8")
            words += ["--config", str(settings)]
        self.command = [program, *words]
        self._counts: dict[Path, int] = {}
        self._cancelled = False
        self._lines: list[str] = []
        self._progress = folder / "progress.json"
        command, environment = module_command(f"{program}.cli", words)
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env={
                **environment,
                **store(folder / "results.pickle"),
                PROGRESS: str(self._progress),
            },
            text=True,
            errors="replace",
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True, name=request.COMMAND)
        self._reader.start()

    @property
    def ended(self) -> bool:
        """Whether it has ended, by itself or not."""
        return self._process.poll() is not None

    @property
    def succeeded(self) -> bool:
        """Whether it has ended without an error."""
        return self._process.poll() == 0

    @property
    def words(self) -> list[str]:
        """The last lines that it has printed."""
        return self._lines[-12:]

    def wait_for_news(self) -> bool:
        """Wait until the page is to be told again; return whether the command goes on."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(REFRESH)
        return not self.ended

    def count_frames(self) -> int:
        """Return how many frames are tracked so far."""
        for part in sorted(self.output.glob(PARTS)):
            if part not in self._counts:
                with suppress(UserError):  # it may just have been removed
                    self._counts[part] = len(Track.open(part))
        return sum(self._counts.values())

    @property
    def share(self) -> float:
        """The share of its work that is done, 0 to 1."""
        return StatedProgress.read(self._progress).share

    def describe(self) -> str:
        """Return what it is doing."""
        if self.ended:
            return "done" if self.succeeded else "ended early"
        if self._cancelled:
            return "ending ..."
        stated = StatedProgress.read(self._progress)
        left = "" if stated.left is None else f", {timedelta(seconds=round(stated.left))} left"
        return f"{stated.words or 'beginning'}{left}"

    def cancel(self) -> None:
        """Interrupt it: it writes the frames that are tracked, and ends. Not by Ctrl-C's signal,
        which the page, and with it the command, may have been started to ignore."""
        self._cancelled = True
        if not self.ended:
            self._process.terminate()

    def close(self) -> None:
        """Interrupt it, wait until it has ended, and remove its settings."""
        self.cancel()
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(timeout=5)
        self._files.close()

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                if line.strip() and not _DRAWN.intersection(line):
                    self._lines.append(line.rstrip())


def state_flags(request: Request) -> list[str]:
    """Return the words by which a command line states the flags of a request."""
    values, positional, flags = request.stated.values, list[str](), list[str]()
    for option in list_options(type(request)):
        plain = option.plain(values.get(option.dest))
        if plain is None or plain is False:
            continue
        items = [str(item) for item in (plain if option.several else [plain])]
        if option.flag.positional:
            positional += items
        elif option.switch:
            flags.append(f"--{option.name}")
        elif option.several:
            flags += [f"--{option.name}", *items]
        else:
            flags.append(f"--{option.name}={items[0]}")
    return [*positional, *flags]

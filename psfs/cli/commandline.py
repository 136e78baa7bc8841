"""Parts shared by the commands `psfs` and `apf`: messages, the log file, common flags."""

from __future__ import annotations

import argparse
import logging
import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TextIO

from cl import InputError
from psfs.common.ranges import escape_unprintable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table


#: Columns of output into a file or a pipe, which has no width of its own: room for the widest
#: table.
_UNLIMITED = 160
#: No markup anywhere: paths and names hold brackets.
_PLAIN: dict[str, Any] = {"highlight": False, "markup": False, "emoji": False}


class Messages:
    """Texts and tables printed on a stream, and into the log file if there is one. rich's console
    is created with the first message, since importing it takes a while."""

    #: The log file, and whether a command has applied its flags; of all streams.
    log: ClassVar[Console | None] = None
    applied: ClassVar[bool] = False

    def __init__(self, stderr: bool = False) -> None:
        self.quiet = False
        self._stderr = stderr

    @cached_property
    def console(self) -> Console:
        """The console of rich."""
        from rich import console

        class Terminal(console.Console):
            def on_broken_pipe(self) -> None:
                """Print nothing more, for nobody reads it (`apf evaluate | head -1`). rich would
                exit, and the files of the command would not be written."""
                self.quiet = True
                os.dup2(os.open(os.devnull, os.O_WRONLY), self.file.fileno())

        own = (sys.stderr if self._stderr else sys.stdout).isatty() or "COLUMNS" in os.environ
        width = None if own else _UNLIMITED
        return Terminal(**_PLAIN, width=width, stderr=self._stderr)

    def print(self, *objects: Any, **options: Any) -> None:
        """Print like rich's console, without control characters; text is not wrapped. Only into the
        log file if `quiet`."""
        options.setdefault("soft_wrap", all(isinstance(item, str) for item in objects))
        objects = tuple(
            "\n".join(map(escape_unprintable, item.split("\n"))) if isinstance(item, str) else item
            for item in objects
        )
        if not self.quiet:
            self.console.print(*objects, **options)
        if self.log is not None:
            self.log.print(*objects, soft_wrap=True)


#: Results go to standard output, progress and messages to standard error.
stdout, stderr = Messages(), Messages(stderr=True)


def warn(text: str, stream: Messages = stderr) -> None:
    """Print a warning on `stream`; with --quiet on standard error."""
    remark("warning", "yellow", text, stderr if stdout.quiet else stream)


def remark(kind: str, style: str, text: str, stream: Messages = stdout) -> None:
    """Print `kind: text`, the kind in a colour."""
    from rich.text import Text

    stream.print(Text.assemble((f"{kind}:", style), f" {escape_unprintable(text)}"), soft_wrap=True)


@contextmanager
def messages(args: argparse.Namespace) -> Iterator[None]:
    """Apply --verbose, --quiet and --log-file; a command within a command keeps the settings of the
    outer one. Raises InputError if the log file cannot be written."""
    if Messages.applied:
        yield
        return
    root = logging.getLogger()
    level_before = root.level
    with ExitStack() as stack:
        shown = logging.StreamHandler()
        shown.setFormatter(logging.Formatter("%(name)s: %(message)s"))
        shown.setLevel(logging.INFO if args.verbose else logging.WARNING)
        handlers: list[logging.Handler] = [shown]
        log = None
        if args.log_file is not None:
            from rich.console import Console

            file = stack.enter_context(_open_log(args.log_file))
            log = Console(file=file, width=_UNLIMITED, color_system=None, **_PLAIN)
            handlers.append(logging.StreamHandler(file))
            handlers[-1].setFormatter(logging.Formatter("%(asctime)s %(name)s: %(message)s"))
        if not sys.warnoptions:
            # Those of NumPy and other libraries say nothing that a user can mend; --verbose and
            # the log file have them.
            handlers[0].addFilter(lambda record: args.verbose or record.name != "py.warnings")
            logging.captureWarnings(True)
            stack.callback(logging.captureWarnings, False)
        for handler in handlers:
            root.addHandler(handler)
            stack.callback(root.removeHandler, handler)
        stack.callback(root.setLevel, level_before)
        root.setLevel(logging.INFO if args.verbose or log else logging.WARNING)
        Messages.applied, Messages.log, stdout.quiet = True, log, args.quiet
        try:
            yield
        finally:
            Messages.applied, Messages.log, stdout.quiet = False, None, False


def log_line(text: str) -> None:
    """Write a line, with the time, into the log file, if there is one."""
    if Messages.log is not None:
        now = datetime.now().strftime("%Y-%m-%d %H:%M:%S")
        Messages.log.print(f"{now} {text}", soft_wrap=True)


def _open_log(path: Path) -> TextIO:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not (path.is_file() and _is_log(path)):
            raise InputError(f"--log-file {path}: is no log of psfs or apf; expected another file")
        return path.open("a", encoding="utf-8", buffering=1)
    except OSError as error:
        raise InputError(f"--log-file {path}: cannot be written: {error.strerror}") from None


def _is_log(path: Path) -> bool:
    """Return whether a file is empty or begins like a line of `log_line`. Nothing is appended to
    other files."""
    with path.open("rb") as file:
        first = file.read(32)
    began = re.match(rb"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d[ ,]", first)
    return not first or began is not None


def add_message_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of all subcommands: amount and destination of the messages."""
    group = parser.add_argument_group("messages")
    loudness = group.add_mutually_exclusive_group()
    loudness.add_argument("-v", "--verbose", action="store_true", help="say what is being done")
    loudness.add_argument(
        "-q", "--quiet", action="store_true", help="show warnings and errors only"
    )
    group.add_argument(
        "--log-file",
        type=Path,
        metavar="FILE",
        help="append all messages to FILE, with the times and the traceback of an error",
    )


def progress_bar() -> Progress:
    """Return a progress bar for long work, on standard error."""
    from rich import progress

    from psfs.common.bars import FollowedProgress

    return FollowedProgress(
        progress.TextColumn("{task.description}", markup=False),
        progress.BarColumn(),
        progress.MofNCompleteColumn(),
        progress.TimeElapsedColumn(),
        progress.TimeRemainingColumn(),
        console=stderr.console,
        disable=stdout.quiet,
    )


def make_table(title: str, names: Sequence[str], figures: Sequence[str]) -> Table:
    """Return a table without rows: columns of names, then of figures, to the right."""
    from rich.table import Table

    table = Table(*names, title=title, title_justify="left")
    for column in figures:
        table.add_column(column, justify="right")
    return table

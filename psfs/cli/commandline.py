"""What the commands `psfs` and `apf` share: messages, the log file, common flags."""

from __future__ import annotations

import argparse
import logging
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, NoReturn, TextIO

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from cl import InputError
from psfs.common.files import resolve_path
from psfs.common.names import escape_unprintable

#: Columns of a file or a pipe, which has no width of its own: room for the widest table.
_UNLIMITED = 160


class Messages(Console):
    """A console whose texts and tables also go into the log file, where there is one."""

    def on_broken_pipe(self) -> None:
        raise  # rich would exit; it calls this where it handles the error

    def print(self, *objects: Any, **options: Any) -> None:
        objects = tuple(_printable(item) if isinstance(item, str) else item for item in objects)
        super().print(*objects, **options)
        if _state.log is not None and all(isinstance(item, (str, Text, Table)) for item in objects):
            _state.log.print(*objects, soft_wrap=True)


def _printable(text: str) -> str:
    return "\n".join(escape_unprintable(line) for line in text.split("\n"))


@dataclass
class _State:
    """What the flags of the running command say of its messages."""

    running: bool = False
    quiet: bool = False
    log: Console | None = None


_state = _State()


def _console(stream: TextIO, **options: Any) -> Messages:
    own = stream.isatty() or "COLUMNS" in os.environ
    width = None if own else _UNLIMITED
    # No markup anywhere: paths and names hold brackets.
    return Messages(highlight=False, markup=False, emoji=False, width=width, **options)


#: Results go to standard output, progress and messages to standard error.
stdout = _console(sys.stdout)
stderr = _console(sys.stderr, stderr=True)


def warn(text: str, console: Console = stderr) -> None:
    """Print a warning, on standard error where results are not wanted."""
    console = stderr if _state.quiet else console
    remark("warning", "yellow", text, console)


def remark(kind: str, style: str, text: str, console: Console = stdout) -> None:
    """Print `kind: text`, the kind in a colour."""
    console.print(
        Text.assemble((f"{kind}:", style), f" {escape_unprintable(text)}"), soft_wrap=True
    )


class CommandParser(argparse.ArgumentParser):
    """A parser whose errors are one line; so are those of its subcommands."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {escape_unprintable(message)}; see {self.prog} --help\n")


@contextmanager
def messages(args: argparse.Namespace) -> Iterator[None]:
    """Print and log as --verbose, --quiet and --log-file say; a command within a command does as
    the outer one. Raises InputError if the log file cannot be written."""
    if _state.running:
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
            file = stack.enter_context(_opened(args.log_file))
            log = Console(file=file, width=_UNLIMITED, color_system=None, highlight=False,
                          markup=False, emoji=False)  # fmt: skip
            handlers.append(logging.StreamHandler(file))
            handlers[-1].setFormatter(logging.Formatter("%(asctime)s %(name)s: %(message)s"))
        for handler in handlers:
            root.addHandler(handler)
            stack.callback(root.removeHandler, handler)
        stack.callback(root.setLevel, level_before)
        root.setLevel(logging.INFO if args.verbose or log else logging.WARNING)
        _state.running, _state.quiet, _state.log = True, args.quiet, log
        stdout.quiet = args.quiet
        try:
            yield
        finally:
            _state.running, _state.quiet, _state.log = False, False, None
            stdout.quiet = False


def log_line(text: str) -> None:
    """Write a line, with the time, into the log file, where there is one."""
    if _state.log is not None:
        now = datetime.now().strftime("%Y-%m-%d %H:%M:%S")
        _state.log.print(f"{now} {text}", soft_wrap=True)


def _opened(path: Path) -> TextIO:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_file() and not _is_log(path):
            raise InputError(f"--log-file {path}: is no log of psfs or apf; expected another file")
        return path.open("a", encoding="utf-8", buffering=1)
    except OSError as error:
        raise InputError(f"--log-file {path}: cannot be written: {error.strerror}") from None


def _is_log(path: Path) -> bool:
    """Is a file empty, or does it begin as `log_line` does? Nothing is appended to other files."""
    with path.open("rb") as file:
        first = file.read(32)
    began = re.match(rb"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d[ ,]", first)
    return not first or began is not None


def add_command(
    commands: argparse._SubParsersAction,
    name: str,
    run: Callable[[argparse.Namespace], None],
    help: str,
) -> argparse.ArgumentParser:
    """Add a subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=help, description=help, allow_abbrev=False
    )
    parser.set_defaults(run=run, command=name)
    return parser


def add_message_flags(parser: argparse.ArgumentParser) -> None:
    """Add what all subcommands have: how much is said, and where."""
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


def add_device_flag(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--device",
        default="auto",
        metavar="auto|gpu|cpu|numpy|NAME",
        help="where to compute: any part of a name that `psfs devices` lists, gpu:1 for the second "
        "GPU, or numpy for the reference implementation (default: auto)",
    )


def path_or_name(text: str) -> str:
    """Return a path in full where there is such a file or folder, else the text (argparse type)."""
    path = Path(text)
    return str(resolve_path(path)) if path.exists() else text


def progress_bar() -> Progress:
    """Make the bar that all long work shows, on standard error."""
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=stderr,
        disable=_state.quiet,
    )


def frame_range(text: str) -> slice:
    """Return `a:b`, `a:`, `:b`, `a:b:step` or a single frame number, as a slice (argparse type)."""
    try:
        parts = [int(part) if part else None for part in text.split(":")]
        if len(parts) == 1 and parts[0] is not None:
            parts = [parts[0], parts[0] + 1]
        if not 2 <= len(parts) <= 3 or any(p is not None and p < 0 for p in parts):
            raise ValueError
        if len(parts) == 3 and parts[2] == 0:
            raise ValueError
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no frame range; expected a:b, a:b:step or a number, counted from 0"
        ) from None
    return slice(*parts)

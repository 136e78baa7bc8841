"""What the commands `psfs` and `apf` share: errors as one line, exit codes, common flags."""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections.abc import Callable
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
from rich.text import Text

from psfs.cli.outcome import exit_code
from psfs.common.names import printable

#: Columns of a file or a pipe, which has no width of its own: room for the widest table.
_UNLIMITED = 160


def _console(stream: TextIO, **options: Any) -> Console:
    own = stream.isatty() or "COLUMNS" in os.environ
    width = None if own else _UNLIMITED
    # No markup anywhere: paths and names hold brackets.
    return Console(highlight=False, markup=False, emoji=False, width=width, **options)


#: Results go to standard output, progress and messages to standard error.
stdout = _console(sys.stdout)
stderr = _console(sys.stderr, stderr=True)


def warn(text: str, console: Console = stderr) -> None:
    """Print a warning."""
    remark("warning", "yellow", text, console)


def remark(kind: str, style: str, text: str, console: Console = stdout) -> None:
    """Print `kind: text`, the kind in a colour."""
    console.print(Text.assemble((f"{kind}:", style), f" {printable(text)}"), soft_wrap=True)


class CommandParser(argparse.ArgumentParser):
    """A parser whose errors are one line; so are those of its subcommands."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {printable(message)}; see {self.prog} --help\n")


def run_command(parser: argparse.ArgumentParser, argv: list[str] | None = None) -> int:
    """Parse, run the chosen subcommand's `run(args)` and return the exit code of
    `psfs.cli.outcome`."""
    words = sys.argv[1:] if argv is None else argv

    def run() -> None:
        if any("\0" in word for word in words):
            parser.error("an argument holds the character NUL; expected text")
        args = parser.parse_args(words)
        logging.basicConfig(
            level=logging.INFO if args.verbose else logging.WARNING,
            format="%(name)s: %(message)s",
        )
        args.run(args)

    return exit_code(parser.prog, run)


def add_command(
    commands: argparse._SubParsersAction,
    name: str,
    run: Callable[[argparse.Namespace], None],
    help: str,
) -> argparse.ArgumentParser:
    """Add a subcommand with the flags that all have."""
    parser: argparse.ArgumentParser = commands.add_parser(name, help=help, description=help)
    parser.add_argument("-v", "--verbose", action="store_true", help="say what is being done")
    parser.set_defaults(run=run)
    return parser


def add_device_flag(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--device",
        default="auto",
        metavar="auto|gpu|cpu|numpy|NAME",
        help="where to compute: any part of a name that `psfs devices` lists, "
        "or numpy for the reference implementation (default: auto)",
    )


def progress_bar() -> Progress:
    """Make the bar that all long work shows, on standard error."""
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=stderr,
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

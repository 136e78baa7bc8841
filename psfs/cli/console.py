"""The consoles of rich that messages are printed on; imported with the first message."""

from __future__ import annotations

import os
import sys
from typing import TextIO

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from psfs.common.bars import FollowedProgress

#: Columns of output into a file or a pipe, which has no width of its own: room for the widest
#: table.
_UNLIMITED = 160


class _Terminal(Console):
    def on_broken_pipe(self) -> None:
        """Print nothing more, for nobody reads it (`apf evaluate | head -1`). rich would exit, and
        the files of the command would not be written."""
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.file.fileno())


def make_terminal(stderr: bool) -> Console:
    """Return a console on standard output, or on standard error."""
    own = (sys.stderr if stderr else sys.stdout).isatty() or "COLUMNS" in os.environ
    width = None if own else _UNLIMITED
    # No markup anywhere: paths and names hold brackets.
    return _Terminal(highlight=False, markup=False, emoji=False, width=width, stderr=stderr)


def make_log_console(file: TextIO) -> Console:
    """Return a console that writes into a log file."""
    return Console(
        file=file, width=_UNLIMITED, color_system=None, highlight=False, markup=False, emoji=False
    )


def make_progress_bar(console: Console, hidden: bool) -> Progress:
    """Return the progress bar for long work."""
    return FollowedProgress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=hidden,
    )

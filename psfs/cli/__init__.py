"""The command `psfs`. Its imports, which take a second, follow when it runs."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable


def start_program(program: str, run: Callable[[], int]) -> int:
    """Return the exit code of `run`. Ctrl-C ends it with one line. Closed standard streams (`psfs
    ... >&-`) are redirected to the null device: otherwise the first opened files would take their
    place."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: PTH123, SIM115
    try:
        return run()
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return 128 + signal.SIGINT  # as shells say it


def main(argv: list[str] | None = None) -> int:
    """Run the command with these arguments, the process's own by default; return its exit code."""

    def run() -> int:
        from psfs.cli.commands import COMMANDS, EXAMPLE
        from psfs.cli.program import run_program

        description = "Probabilistic shape from silhouette: calibrated views to voxels."
        return run_program("psfs", description, COMMANDS, argv, EXAMPLE)

    return start_program("psfs", run)

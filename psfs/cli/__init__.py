"""The command `psfs`. Its imports, which take a second, follow when it runs."""

from __future__ import annotations

import os
import signal
import sys
from importlib import import_module


def start_program(program: str, description: str, argv: list[str] | None) -> int:
    """Run the command of `psfs` or `apf` that `argv` states; return its exit code. Ctrl-C ends it
    with one line. Closed standard streams (`psfs ... >&-`) are redirected to the null device:
    otherwise the first opened files would take their place."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: PTH123, SIM115
    try:
        from psfs.cli.program import run_program

        commands = import_module(f"{program}.cli.commands")
        return run_program(program, description, commands.COMMANDS, argv, commands.EXAMPLE)
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return 128 + signal.SIGINT  # as shells say it


def main(argv: list[str] | None = None) -> int:
    """Run the command with these arguments, the process's own by default; return its exit code."""
    description = "Probabilistic shape from silhouette: calibrated views to voxels."
    return start_program("psfs", description, argv)

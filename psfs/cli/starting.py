"""Start of a program, before its imports, which take a second; this module imports nothing slow
itself."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

_INTERRUPTED = 130


def start_program(program: str, run: Callable[[], int]) -> int:
    """Return the exit code of `run`, which imports the program and runs it.

    Ctrl-C during the imports ends with one line. Closed standard streams (`psfs ... >&-`) are
    redirected to the null device: otherwise the first opened files would take their place.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: PTH123, SIM115
    try:
        return run()
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return _INTERRUPTED

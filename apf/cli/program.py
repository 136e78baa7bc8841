"""The program `apf`, with some of its subcommands or all."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

import psfs.cli.program


def run_program(commands: Sequence[ModuleType], argv: Sequence[str] | None = None) -> int:
    """Run the one of these subcommands, modules with `register`, that `argv` names; return the exit
    code. argv: the process's own by default."""
    description = "A skeleton per frame from synchronised calibrated views."
    return psfs.cli.program.run_program("apf", description, commands, argv)

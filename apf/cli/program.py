"""The parser of a program with subcommands."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

from psfs.cli.commandline import CommandParser, run_command


def run_program(commands: Sequence[ModuleType], argv: Sequence[str] | None = None) -> int:
    """Run the one of these subcommands, modules with `register`, that `argv` names; return the exit
    code. argv: the process's own by default."""
    parser = CommandParser(
        prog="apf", description="A skeleton per frame from synchronised calibrated views."
    )
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in commands:
        command.register(subparsers)
    return run_command(parser, None if argv is None else list(argv))

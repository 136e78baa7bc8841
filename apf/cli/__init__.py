"""The command line of `apf`."""

from __future__ import annotations

from psfs.cli import start_program


def main(argv: list[str] | None = None) -> int:
    """Run the command with these arguments, by default those of the process; return its exit
    code."""

    def run() -> int:
        from apf.cli.commands import COMMANDS, EXAMPLE
        from psfs.cli.program import run_program

        description = "A skeleton per frame from synchronised calibrated views."
        return run_program("apf", description, COMMANDS, argv, EXAMPLE)

    return start_program("apf", run)

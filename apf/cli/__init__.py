"""The command line of `apf`."""

from __future__ import annotations

from psfs.cli import start_program


def main(argv: list[str] | None = None) -> int:
    """Run the command with these arguments, by default those of the process; return its exit
    code."""
    return start_program("apf", "A skeleton per frame from synchronised calibrated views.", argv)

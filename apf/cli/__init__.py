"""The command `apf`."""

from __future__ import annotations

from apf.cli import demo, evaluate, export, live, render, report, smooth, synth, track, view
from apf.cli.batch import command as batch
from apf.cli.keypoints import command as keypoints
from psfs.cli.program import run_program

COMMANDS = (
    synth, keypoints, track, batch, live, smooth, export, evaluate, report, render, view, demo,
)  # fmt: skip
DESCRIPTION = "A skeleton per frame from synchronised calibrated views."


def main(argv: list[str] | None = None) -> int:
    """Run the command with these arguments, the process's own by default; return its exit code."""
    return run_program("apf", DESCRIPTION, COMMANDS, argv)

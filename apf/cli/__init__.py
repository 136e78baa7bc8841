"""The command `apf`."""

from __future__ import annotations

from apf.cli import demo, evaluate, export, live, render, smooth, synth, track, view
from apf.cli.batch import command as batch
from apf.cli.keypoints import command as keypoints
from apf.cli.program import run_program

COMMANDS = (
    synth, keypoints, track, batch, live, smooth, export, evaluate, render, view, demo,
)  # fmt: skip


def main(argv: list[str] | None = None) -> int:
    """Run the command with these arguments, the process's own by default; return its exit code."""
    return run_program(COMMANDS, argv)

"""The command `apf`."""

from __future__ import annotations

from psfs.cli.starting import started


def main(argv: list[str] | None = None) -> int:
    """Run the command with these arguments, the process's own by default; return its exit code."""

    def run() -> int:
        from apf.cli import demo, evaluate, export, live, render, report, smooth, synth, track, view
        from apf.cli.batch import command as batch
        from apf.cli.keypoints import command as keypoints
        from psfs.cli.program import run_program

        commands = (
            synth, keypoints, track, batch, live, smooth, export, evaluate, report, render, view,
            demo,
        )  # fmt: skip
        description = "A skeleton per frame from synchronised calibrated views."
        return run_program("apf", description, commands, argv)

    return started("apf", run)

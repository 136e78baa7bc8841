"""The command `psfs`."""

from __future__ import annotations

from psfs.cli.starting import start_program


def main(argv: list[str] | None = None) -> int:
    """Run the command with these arguments, the process's own by default; return its exit code."""

    def run() -> int:
        from psfs.cli.commands import COMMANDS
        from psfs.cli.program import run_program

        description = "Probabilistic shape from silhouette: calibrated views to voxels."
        return run_program("psfs", description, COMMANDS, argv)

    return start_program("psfs", run)

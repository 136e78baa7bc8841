"""The command `psfs`."""

from __future__ import annotations

from psfs.cli import calibrate, check, convert, devices, info, mesh, reconstruct, silhouettes, view
from psfs.cli.program import run_program

COMMANDS = (info, calibrate, convert, reconstruct, silhouettes, check, mesh, view, devices)


def main(argv: list[str] | None = None) -> int:
    """Run the command with these arguments, the process's own by default; return its exit code."""
    description = "Probabilistic shape from silhouette: calibrated views to voxels."
    return run_program("psfs", description, COMMANDS, argv)

"""The command `psfs`."""

from __future__ import annotations

from psfs.cli.starting import started


def main(argv: list[str] | None = None) -> int:
    """Run the command with these arguments, the process's own by default; return its exit code."""

    def run() -> int:
        from psfs.cli import (
            calibrate,
            check,
            convert,
            devices,
            info,
            mesh,
            reconstruct,
            silhouettes,
            view,
        )
        from psfs.cli.program import run_program

        commands = (info, calibrate, convert, reconstruct, silhouettes, check, mesh, view, devices)
        description = "Probabilistic shape from silhouette: calibrated views to voxels."
        return run_program("psfs", description, commands, argv)

    return started("psfs", run)

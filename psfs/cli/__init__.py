"""The command `psfs`."""

from __future__ import annotations

from psfs.cli import check, devices, info, mesh, reconstruct, silhouettes, view
from psfs.cli.commandline import CommandParser, run_command


def main(argv: list[str] | None = None) -> int:
    parser = CommandParser(
        prog="psfs", description="Probabilistic shape from silhouette: calibrated views to voxels."
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in (info, reconstruct, silhouettes, check, mesh, view, devices):
        command.register(commands)
    return run_command(parser, argv)

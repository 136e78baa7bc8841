"""The command `psfs`."""

from __future__ import annotations

import argparse
import importlib
import sys
from importlib.util import find_spec

from psfs.commandline import run_command

_COMMANDS = ("info", "reconstruct", "check", "view", "devices")


def parser() -> argparse.ArgumentParser:
    """The argument parser with all subcommands."""
    psfs = argparse.ArgumentParser(
        prog="psfs", description="Probabilistic shape from silhouette: calibrated views to voxels."
    )
    commands = psfs.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name in _COMMANDS:
        if find_spec(f"psfs.commands.{name}"):
            importlib.import_module(f"psfs.commands.{name}").register(commands)
    return psfs


def main(argv: list[str] | None = None) -> int:
    return run_command(parser(), argv)


if __name__ == "__main__":
    sys.exit(main())

"""The flags of `psfs check`."""

from __future__ import annotations

import argparse

from psfs.cli.commandline import add_device_flag, add_run_folder
from psfs.diagnostics.definitions import DEFINITION


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    what = parser.description
    parser.description = f"{what}. {DEFINITION}. Writes OUT/check.json."
    add_run_folder(parser)
    add_device_flag(parser)

"""The flags of `psfs check`."""

from __future__ import annotations

import argparse
from pathlib import Path

from psfs.cli.commandline import add_device_flag
from psfs.diagnostics.definitions import DEFINITION


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    what = parser.description
    parser.description = f"{what}. {DEFINITION}. Writes OUT/check.json."
    parser.add_argument("out", metavar="OUT", type=Path, help="output folder of psfs reconstruct")
    add_device_flag(parser)

"""The flags of `apf demo`."""

from __future__ import annotations

import argparse
from pathlib import Path

from psfs.cli.commandline import add_device_flag


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    parser.add_argument("-o", "--output", type=Path, default=Path("demo"), metavar="FOLDER")
    parser.add_argument("--frames", type=int, default=60, metavar="N")
    parser.add_argument("--cameras", type=int, default=4, metavar="N")
    add_device_flag(parser)

"""The flags of `apf report`."""

from __future__ import annotations

import argparse
from pathlib import Path

from psfs.cli.commandline import add_device_flag


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    parser.add_argument("track", type=Path, metavar="OUT", help="folder that `apf track` wrote")
    parser.add_argument("--no-overlay", action="store_true", help="draw no overlay that is missing")
    add_device_flag(parser)

"""The flags of `apf report`."""

from __future__ import annotations

import argparse

from apf.cli.flags.shared import add_track_path
from psfs.cli.commandline import add_device_flag


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_track_path(parser, "OUT")
    parser.add_argument("--no-overlay", action="store_true", help="draw no overlay that is missing")
    add_device_flag(parser)

"""The flags of `psfs info`."""

from __future__ import annotations

import argparse
from pathlib import Path

from psfs.cli.commandline import add_device_flag, add_overwrite_flag
from psfs.cli.sequence_flags import add_sequence_flags
from psfs.cli.sequence_flags import check as check


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_sequence_flags(parser, frames=False)
    parser.add_argument(
        "--no-pictures",
        dest="pictures",
        action="store_false",
        help="do not examine the pictures for faults, which takes seconds",
    )
    parser.add_argument(
        "--masks",
        type=Path,
        metavar="FILE",
        help="write the examined silhouettes of all cameras, in some frames, as one picture",
    )
    add_overwrite_flag(parser)
    add_device_flag(parser)

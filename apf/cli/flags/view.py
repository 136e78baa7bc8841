"""The flags of `apf view`."""

from __future__ import annotations

import argparse
from pathlib import Path

from apf.cli.flags.shared import add_body_flag
from psfs.cli.flags.view import add_view_flags


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    parser.add_argument(
        "out", metavar="OUT", type=Path, help="output folder of apf track, or of psfs reconstruct"
    )
    parser.add_argument(
        "track",
        metavar="TRACK",
        type=Path,
        nargs="?",
        help="folder that `apf track` wrote, whose body is shown in the voxels of OUT",
    )
    add_view_flags(parser)
    add_body_flag(parser)

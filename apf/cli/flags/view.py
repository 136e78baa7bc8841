"""The flags of `apf view`."""

from __future__ import annotations

import argparse
from pathlib import Path

from psfs.cli.flags.view import add_view_flags


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_view_flags(parser)
    parser.add_argument("track", type=Path, metavar="TRACK", help="folder that `apf track` wrote")
    parser.add_argument(
        "--body", type=Path, metavar="B", help="body model of a track that does not hold its own"
    )

"""The flags of `apf smooth`."""

from __future__ import annotations

import argparse
from pathlib import Path

from apf.cli.flags.shared import add_smoothing_flags


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    parser.add_argument("track", type=Path, metavar="TRACK", help="folder that `apf track` wrote")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT")
    add_smoothing_flags(parser, "cutoff", "lag")

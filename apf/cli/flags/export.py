"""The flags of `apf export`."""

from __future__ import annotations

import argparse
from pathlib import Path

from apf.cli.flags.shared import add_smoothing_flags
from apf.formats.axes import AXES
from apf.tracking.exports import EXPORTS, OF_POINTS


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    parser.add_argument("track", type=Path, metavar="OUT", help="folder of `apf track`, or its npz")
    parser.add_argument(
        "--to",
        nargs="+",
        choices=tuple(EXPORTS),
        metavar="FORMAT",
        help=f"{', '.join(EXPORTS)} (default: all; of a track without a body "
        f"{', '.join(OF_POINTS)})",
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FOLDER", help="where to (default: beside the track)"
    )
    parser.add_argument(
        "--axes",
        choices=AXES,
        default="y-up",
        help="of the TRC: y-up (X Y Z) = world (x z -y), z-up = world (x y z), pose2sim = "
        "world (y z x) (default: %(default)s)",
    )
    add_smoothing_flags(parser, "cutoff")
    parser.add_argument(
        "--raw", action="store_true", help="the poses as they were tracked, without smoothing"
    )

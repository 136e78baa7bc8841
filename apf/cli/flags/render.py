"""The flags of `apf render`."""

from __future__ import annotations

import argparse
from pathlib import Path

from apf.cli.shape_flags import add_shape_flags
from psfs.cli.commandline import add_device_flag
from psfs.cli.sequence_flags import add_sequence_flags
from psfs.cli.sequence_flags import check as check


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_sequence_flags(parser)
    parser.add_argument("track", type=Path, metavar="TRACK", help="folder that `apf track` wrote")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT")
    parser.add_argument(
        "--body", type=Path, metavar="B", help="body model of a track that does not hold its own"
    )
    add_shape_flags(parser)
    parser.add_argument("--opengl", action="store_true", help="render by OpenGL instead of OpenCL")
    add_device_flag(parser)

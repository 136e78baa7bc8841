"""The flags of `apf render`."""

from __future__ import annotations

import argparse

from apf.cli.flags.shared import add_body_flag, add_track_path
from apf.cli.shape_flags import add_shape_flags
from psfs.cli.commandline import add_device_flag, add_output_flag
from psfs.cli.sequence_flags import add_sequence_flags
from psfs.cli.sequence_flags import check as check


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_sequence_flags(parser)
    add_track_path(parser, "TRACK")
    add_output_flag(parser)
    add_body_flag(parser)
    add_shape_flags(parser)
    parser.add_argument("--opengl", action="store_true", help="render by OpenGL instead of OpenCL")
    add_device_flag(parser)

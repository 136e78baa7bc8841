"""The flags of `apf export`."""

from __future__ import annotations

import argparse
from pathlib import Path

from apf.cli.flags.shared import add_smoothing_flags, add_track_path
from apf.formats.axes import AXES
from apf.tracking.exports import EXPORTS, OF_POINTS, OPENSIM
from psfs.cli.commandline import add_output_flag


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_track_path(parser, "OUT", "folder of `apf track`, or its npz")
    parser.add_argument(
        "--to",
        nargs="+",
        choices=(*EXPORTS, OPENSIM),
        metavar="FORMAT",
        help=f"{', '.join(EXPORTS)} (default: all; of a track without a body "
        f"{', '.join(OF_POINTS)}), or {OPENSIM}: a scaled OpenSim model and its inverse kinematics",
    )
    parser.add_argument(
        "--osim-model",
        type=Path,
        metavar="FILE",
        help=f"the model that --to {OPENSIM} scales (default: the one that Pose2Sim carries)",
    )
    add_output_flag(
        parser, "where to (default: beside the track)", metavar="FOLDER", required=False
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

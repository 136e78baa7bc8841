"""The flags of `apf keypoints`."""

from __future__ import annotations

import argparse

from psfs.cli.commandline import add_device_flag, add_output_flag
from psfs.cli.sequence_flags import add_sequence_flags
from psfs.cli.sequence_flags import check as check


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_sequence_flags(parser, frames=False, fps=False)
    add_output_flag(
        parser, "folder for OUT/<camera>_json/<camera>_000000.json, as Pose2Sim has them"
    )
    parser.add_argument(
        "--at-once", type=int, metavar="N", help="cameras at a time (default: as many as cores)"
    )
    parser.add_argument(
        "--no-crop",
        action="store_true",
        help="show whole pictures to the network (default: cropped by the silhouette, where the "
        "empty scene is known)",
    )
    parser.add_argument(
        "--people",
        default="1",
        metavar="N",
        help="people to find in each picture: a number, or auto for as many as are seen in "
        "silhouettes (default 1); each where they stand",
    )
    add_device_flag(parser)

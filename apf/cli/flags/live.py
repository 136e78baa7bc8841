"""The flags of `apf live`."""

from __future__ import annotations

import argparse
from pathlib import Path

from apf.cli.flags.shared import add_start_flags
from apf.cli.method_flags import add_method_flags
from apf.settings import Settings
from psfs.cli.commandline import add_device_flag, add_output_flag
from psfs.cli.sequence_flags import (
    add_sequence_flags,
)
from psfs.cli.settings import add_configs


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_sequence_flags(parser, fps=False)  # --fps is the result's rate here
    add_output_flag(parser)
    parser.add_argument(
        "--captures",
        nargs="+",
        metavar="C",
        help="cameras in the order of the calibration that lies in FOLDER (or that FOLDER is): USB "
        "numbers, URLs or videos (default: play the recording in FOLDER at its own rate)",
    )
    parser.add_argument(
        "--empty",
        type=float,
        default=2.0,
        metavar="S",
        help="seconds of the empty scene that --captures begin with, unless FOLDER/background "
        "shows it (default: 2)",
    )
    parser.add_argument(
        "--fps",
        dest="budget",
        type=float,
        metavar="N",
        help="poses per second to be reached, by a search of the size that allows it (default: as "
        "many as frames if that leaves time for a good search, unless --particles or --layers "
        "says a size)",
    )
    add_start_flags(parser)
    parser.add_argument(
        "--people",
        metavar="N",
        help="track N people, each into OUT/person1 and so on, from one reconstruction; auto: as "
        "many as the recording shows; with --captures from --init with the joints of all, in "
        "--volume (default: 1, with a warning if the recording begins with more)",
    )
    parser.add_argument(
        "--truth", type=Path, metavar="F", help="true joints (npz or TRC): to state the error"
    )
    parser.add_argument(
        "--scale",
        type=float,
        metavar="S",
        help="size of the pictures that are looked at, up to 1 (default: on a CPU as small as "
        "pixels still are no larger than voxels, else 1)",
    )
    parser.add_argument(
        "--studio",
        action="store_true",
        help="show the body, latency and dropped frames on a page in the browser, see apf studio",
    )
    add_method_flags(parser)
    add_configs(parser, Settings, "live")
    add_device_flag(parser)

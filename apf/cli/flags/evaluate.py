"""The flags of `apf evaluate`."""

from __future__ import annotations

import argparse
from pathlib import Path

from apf.cli.flags.shared import add_track_path
from apf.evaluation.marker_sets import SHIPPED
from apf.formats.axes import AXES
from psfs.cli.commandline import add_output_flag, path_or_name

#: The files that can be written.
FILES = {"csv": "errors per frame", "plot": "a picture (PNG)", "json": "all figures"}


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_track_path(parser, "OUT", "folder of `apf track`, or its npz")
    parser.add_argument(
        "--truth",
        type=Path,
        required=True,
        nargs="+",
        metavar="FILE",
        help="npz, TRC or C3D; of several people one npz of all, or a file for each",
    )
    parser.add_argument(
        "--markers",
        type=path_or_name,
        metavar="SET",
        help="compare markers on the body with the truth's, by their labels: a TOML file that says "
        f"where each is fixed, or {', '.join(SHIPPED)} (docs/formats.md)",
    )
    parser.add_argument(
        "--truth-start",
        type=float,
        metavar="N",
        help="frame of the truth, counted from 0, that is the sequence's frame 0; truth at another "
        "rate is taken at the frames' times (default: a C3D's own numbers)",
    )
    parser.add_argument(
        "--convention",
        choices=AXES,
        help="axes of a TRC or C3D: y-up (X Y Z) = world (x z -y), as `apf track` writes it; "
        "pose2sim = world (y z x); z-up = world (x y z) (default: of a TRC y-up, "
        "or another one with which it is near the track; what a C3D says)",
    )
    for kind, what in FILES.items():
        parser.add_argument(f"--{kind}", action="store_true", help=f"write {what}")
    add_output_flag(
        parser,
        "where evaluation.csv, .png and .json go (default: beside the track); "
        "all three unless some of --csv, --plot, --json choose",
        metavar="FOLDER",
        required=False,
    )

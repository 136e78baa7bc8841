"""Flags shared by several commands of `apf`."""

from __future__ import annotations

import argparse
from pathlib import Path

from apf.formats.axes import AXES
from apf.tracking.config import SmoothingConfig
from psfs.cli.commandline import path_or_name
from psfs.cli.sequence_flags import voxel_edge
from psfs.cli.setting_flags import add_setting_flags

#: The name of the method.
TRIANGULATE = "triangulate"


def add_start_flags(parser: argparse.ArgumentParser) -> None:
    """Add --body, --init, --height, --convention and --voxel-size."""
    group = parser.add_argument_group("start", "person and first pose")
    group.add_argument(
        "--body",
        type=path_or_name,
        metavar="B",
        help="body model: a TOML file or a shipped name (default: song32, or the sequence's own)",
    )
    group.add_argument(
        "--init",
        type=Path,
        metavar="P",
        help="first pose: a text file with a value per degree of freedom (radians, metres), or "
        "joints (npz or TRC) to whose first frame body and pose are fitted "
        "(default: the sequence's own, where it has one; else found in the first voxels)",
    )
    group.add_argument(
        "--height", type=float, metavar="M", help="stature of the person, m, if it is known"
    )
    group.add_argument(
        "--convention", choices=AXES, default="y-up", help="axes of a TRC (default: y-up)"
    )
    group.add_argument("--voxel-size", type=voxel_edge, metavar="M", help="edge of a voxel, m")


def add_keypoint_flags(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add --keypoints, and return its group."""
    group = parser.add_argument_group("keypoints", "2-D points of any pose network")
    group.add_argument(
        "--keypoints",
        type=path_or_name,
        metavar="PATH",
        help="keypoints in all cameras, in FOLDER or anywhere: keypoints.npz, OpenPose's JSON "
        "(Pose2Sim, Sports2D), OpenCap's pickles, FreeMoCap's arrays, DeepLabCut's tables; PATH "
        "may hold wildcards (default: none, even where there are some)",
    )
    return group


def add_track_path(
    parser: argparse.ArgumentParser, metavar: str, what: str = "folder that `apf track` wrote"
) -> None:
    """Add the positional of commands that read a track; what: its help."""
    parser.add_argument("track", type=Path, metavar=metavar, help=what)


def add_body_flag(parser: argparse.ArgumentParser) -> None:
    """Add --body of commands that read a track."""
    parser.add_argument(
        "--body", type=Path, metavar="B", help="body model of a track that does not hold its own"
    )


def add_smoothing_flags(parser: argparse.ArgumentParser, *settings: str) -> None:
    """Add the flags of these `settings` of the smoothing, and --body."""
    add_setting_flags(parser, SmoothingConfig, only=settings, fill=True)
    add_body_flag(parser)

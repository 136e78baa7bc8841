"""Flags shared by several commands of `apf`."""

from __future__ import annotations

import argparse
from pathlib import Path

from apf.formats.axes import AXES
from apf.keypoints.config import TriangulationConfig
from apf.tracking.config import SmoothingConfig
from psfs.cli.commandline import path_or_name
from psfs.cli.sequence_flags import voxel_edge

#: The name of the method.
TRIANGULATE = "triangulate"


def add_start_flags(parser: argparse.ArgumentParser) -> None:
    """Add --body, --init, --height, --convention and --voxel-size."""
    group = parser.add_argument_group("start", "who is tracked, and from where")
    group.add_argument(
        "--body",
        type=path_or_name,
        metavar="B",
        help="body model: a TOML file or a shipped name (default: song31, or the sequence's own)",
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


def add_triangulation_flags(group: argparse._ArgumentGroup) -> None:
    """Add --low-pass, --max-error and --longest-gap."""
    group.add_argument(
        "--low-pass",
        type=float,
        metavar="HZ",
        help=f"{TRIANGULATE}: Butterworth filter of the points, such as 6 (default: none)",
    )
    group.add_argument(
        "--max-error",
        type=float,
        metavar="PX",
        help=f"{TRIANGULATE}: cameras are left out of a point until the mean reprojection error is "
        f"below (default: {TriangulationConfig().max_error:g})",
    )
    group.add_argument(
        "--longest-gap",
        type=float,
        metavar="S",
        help=f"{TRIANGULATE}: leave longer gaps open, blank in the files (default: all are filled)",
    )


def add_smoothing_flags(parser: argparse.ArgumentParser) -> None:
    """Add --cutoff and --body."""
    parser.add_argument(
        "--cutoff",
        type=float,
        default=SmoothingConfig().cutoff,
        metavar="HZ",
        help="smoothing: motion this fast keeps half of its amplitude (default: %(default)g)",
    )
    parser.add_argument(
        "--body", type=Path, metavar="B", help="body model of a track that does not hold its own"
    )

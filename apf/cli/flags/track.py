"""The flags of `apf track`."""

from __future__ import annotations

import argparse
from pathlib import Path

from apf.cli.flags.shared import (
    TRIANGULATE,
    add_keypoint_flags,
    add_start_flags,
)
from apf.cli.method_flags import add_method_flags
from apf.presets import PRESETS
from apf.report import PAGE
from apf.settings import Settings
from apf.tracking.batch import ON_CPU, ON_GPU
from apf.tracking.config import TriangulatedConfig
from psfs.cli.commandline import add_device_flag, add_output_flag
from psfs.cli.sequence_flags import (
    add_all_cameras_flag,
    add_sequence_flags,
)
from psfs.cli.setting_flags import add_setting_flags
from psfs.cli.settings import add_configs, add_preset_flag

#: Help of -o for one take or several.
OUTPUT_HELP = "folder for the results; of several takes each has its own in it, by its name"


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_output_flag(parser, OUTPUT_HELP)
    add_track_flags(parser)
    parser.add_argument(
        "--corrections",
        type=Path,
        metavar="FILE",
        help="corrections of a track by hand (TOML, as the page of apf studio writes them): parts "
        "of it are tracked again from the corrected frames, the rest stays as it is",
    )
    parser.add_argument(
        "--at-once",
        type=int,
        metavar="N",
        help=f"of several takes, work on N at a time (default: {ON_GPU} on a GPU, else {ON_CPU})",
    )


def add_track_flags(parser: argparse.ArgumentParser) -> None:
    """Add the folders of the takes and all flags of their tracking."""
    add_sequence_flags(parser, several=True)
    add_start_flags(parser)
    add_all_cameras_flag(parser)
    add_method_flags(
        parser, more=f"; {TRIANGULATE}: --keypoints alone, triangulated, without a body"
    )
    add_setting_flags(add_keypoint_flags(parser), TriangulatedConfig)
    parser.add_argument(
        "--seeds",
        type=int,
        metavar="N",
        help="make N runs at once, with seeds from --seed on, into OUT/seed0 and so on, and say "
        "how far they differ",
    )
    parser.add_argument(
        "--people",
        default="auto",
        metavar="N",
        help="track N people, each into OUT/person1 and so on; auto: as many as are seen, a single "
        "one into OUT itself (default: %(default)s)",
    )
    add_configs(parser, Settings, "reconstruction")
    add_preset_flag(parser, PRESETS)
    parser.add_argument(
        "--one-way",
        action="store_true",
        help="track forward alone, as live: in about half of the time, less accurately",
    )
    parser.add_argument("--no-overlay", action="store_true", help="write no overlay.mp4")
    parser.add_argument(
        "--no-report",
        action="store_true",
        help=f"write no {PAGE}, and leave the track uncompared with the silhouettes",
    )
    add_device_flag(parser)

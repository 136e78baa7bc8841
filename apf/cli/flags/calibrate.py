"""The flags of `apf calibrate`."""

from __future__ import annotations

import argparse
from pathlib import Path

from psfs.cli.commandline import add_device_flag, add_output_flag, path_or_name
from psfs.cli.flags.calibrate import CALIBRATION, REPORT, add_field_of_view_flag
from psfs.cli.sequence_flags import PARSERS
from psfs.cli.setting_flags import add_setting_flags
from psfs.cli.settings import add_configs
from psfs.footage import settings as footage
from psfs.settings import Settings


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    what = parser.description
    parser.description = (
        f"{what} FOLDER holds videos/ or images/<camera>/ of somebody who walks about, and "
        f"background/ where there is one. OUT gets {CALIBRATION} (metres, Z up) and {REPORT}. See "
        "docs/calibration.md; without keypoints: psfs calibrate --person."
    )
    parser.add_argument("folder", metavar="FOLDER", help="footage of the person")
    add_output_flag(parser, "folder")
    parser.add_argument(
        "--keypoints", type=path_or_name, metavar="PATH",
        help="keypoints in all cameras, of any program that apf track --keypoints reads (required)",
    )  # fmt: skip
    parser.add_argument(
        "--intrinsics", type=Path, metavar="PATH",
        help="intrinsics that are kept: a calibration, of which only the lenses are taken; or a "
        "folder with a photo by each camera, whose EXIF states a focal length, which is refined",
    )  # fmt: skip
    add_field_of_view_flag(parser.add_argument_group("lenses"))
    parser.add_argument(
        "--stature", type=float, metavar="M",
        help="height of the person, m, which gives the scale (default: 1.7)",
    )  # fmt: skip
    parser.add_argument(
        "--no-silhouettes", action="store_true",
        help="keep what the keypoints say (default: adjusted to the silhouettes, and refused if "
        "these do not fit)",
    )  # fmt: skip
    group = parser.add_argument_group("footage")
    add_setting_flags(group, footage.SequenceSettings, only=("cameras", "fps"), parsers=PARSERS)
    add_device_flag(group)
    add_configs(parser, Settings, "person")

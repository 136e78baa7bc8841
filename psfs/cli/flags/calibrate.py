"""The flags of `psfs calibrate`."""

from __future__ import annotations

import argparse
from pathlib import Path

from psfs.calibration.config import CalibrationConfig
from psfs.calibration.targets.dictionaries import DICTIONARIES
from psfs.cli.commandline import add_device_flag, add_output_flag, frame_range
from psfs.cli.sequence_flags import PARSERS
from psfs.cli.setting_flags import add_setting_flags
from psfs.cli.settings import add_configs
from psfs.footage import settings as footage
from psfs.settings import Settings

#: Names of the written files and folder.
CALIBRATION, REPORT, RIG, PICTURES = "calibration.toml", "calibration.json", "rig.png", "cameras"


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    what = parser.description
    parser.description = (
        f"{what}. FOLDER holds videos/, images/<camera>/, or a video or folder of pictures per "
        f"camera. OUT gets {CALIBRATION} (metres, Z up), {REPORT}, {RIG}, and a picture per camera "
        f"in {PICTURES}/: reprojection errors, where the target was seen, what to do better. "
        "Recipe: docs/calibration.md."
    )
    parser.add_argument(
        "folder", nargs="?", metavar="FOLDER", help="footage of the board, wand or person"
    )
    add_output_flag(parser, "folder", required=False)
    parser.add_argument(
        "--print-board", type=Path, metavar="FILE.pdf",
        help="write a ChArUco board to print, in its true size, and nothing else; --squares "
        "(default: 7x5) and --square (default: 0.037, an A4 page) choose it",
    )  # fmt: skip
    _add_target_flags(parser)
    group = parser.add_argument_group("cameras and world")
    group.add_argument(
        "--intrinsics", type=Path, metavar="PATH",
        help="intrinsics that are kept: a calibration, or a folder with a video or pictures of the "
        "board per camera (default: found, too); of --person also a folder with a photo by each "
        "camera, whose EXIF states a focal length, which is refined",
    )  # fmt: skip
    add_field_of_view_flag(group)
    group.add_argument(
        "--floor", type=frame_range, metavar="FRAME",
        help="frame, or a:b, in which the board or wand lies on the floor: Z = 0, X along it "
        "(default: Z is the cameras' mean up, with a warning)",
    )  # fmt: skip
    group.add_argument(
        "--height", type=float, default=0.0, metavar="M",
        help="of the target's points above the floor, such as the radius of markers (default: 0)",
    )  # fmt: skip
    group = parser.add_argument_group("footage")
    group.add_argument(
        "--frames", type=frame_range, metavar="a:b", help="frames counted from 0, b excluded "
        f"(default: all, at most {CalibrationConfig().most_frames}, evenly spread)",
    )  # fmt: skip
    stated = ("cameras", "fps", "sync", "calibration")
    add_setting_flags(group, footage.SequenceSettings, only=stated, parsers=PARSERS)
    add_device_flag(group)
    add_configs(parser, Settings, "calibration", "person")


def add_field_of_view_flag(group: argparse._ArgumentGroup) -> None:
    """Add --field-of-view, of cameras that a person calibrates."""
    group.add_argument(
        "--field-of-view", type=float, metavar="DEG",
        help="of --person without --intrinsics: the angle of view of the pictures' longer side, "
        "degrees, from which the focal lengths are refined (default: by the metadata of the "
        "footage, such as iPhones write, refined likewise)",
    )  # fmt: skip


def _add_target_flags(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group(
        "target", "one of --board, --wand, --c3d, --person and --refine"
    )
    kind = group.add_mutually_exclusive_group()
    kind.add_argument(
        "--board", metavar="charuco|chessboard|FILE",
        help="a board with squares; FILE: a board that Caliscope (charuco.toml), Pose2Sim "
        "(Config.toml) or OpenCV's calibration sample describes",
    )  # fmt: skip
    kind.add_argument(
        "--wand", type=_lengths, metavar="M|M,M",
        help="a wand of two or three bright markers, m from each to the next: 0.5 or 0.2,0.3",
    )  # fmt: skip
    kind.add_argument(
        "--c3d", type=Path, metavar="FILE",
        help="a wand whose markers a motion-capture system measured; the cameras are placed in "
        "that system's frame",
    )  # fmt: skip
    kind.add_argument(
        "--refine", action="store_true",
        help="no target: correct the cameras of FOLDER, and estimate their sub-frame times, from "
        "the silhouettes of a moving person; the cameras are kept as they are unless held-out "
        "frames fit better",
    )  # fmt: skip
    kind.add_argument(
        "--person", action="store_true",
        help="no target: cameras and times from the silhouettes of somebody who walks about; "
        "needs --intrinsics or --field-of-view, unless metadata state the lenses",
    )  # fmt: skip
    group.add_argument(
        "--stature", type=float, metavar="M",
        help="height of the person of --person, m, which gives the scale (default: 1.7)",
    )  # fmt: skip
    _add_board_flags(group)
    group.add_argument(
        "--markers", type=lambda text: text.split(","), metavar="A,B[,C]",
        help="names of the wand's markers in the C3D file, along it (default: all of the file)",
    )  # fmt: skip
    group.add_argument(
        "--c3d-begins", type=float, default=0.0, metavar="S",
        help="s after the first picture at which the C3D file begins (default: 0)",
    )  # fmt: skip
    group.add_argument(
        "--up", metavar="AXIS", help="up axis of the C3D file: z, -z, y, -y, x or -x (default: z)"
    )


def _add_board_flags(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--squares", type=_squares, metavar="CxR", help="squares of the board, as 7x5, not "
        "the inner corners",
    )  # fmt: skip
    group.add_argument("--square", type=float, metavar="M", help="side of a square, m")
    group.add_argument(
        "--marker", type=float, metavar="M",
        help="side of a ChArUco board's markers, m (default: 3/4 of a square)",
    )  # fmt: skip
    group.add_argument(
        "--dictionary", default="auto", choices=("auto", *DICTIONARIES),
        help="markers of a ChArUco board (default: those that are seen)",
    )  # fmt: skip
    group.add_argument(
        "--boards", type=int, default=1, metavar="N",
        help="number of ChArUco boards of these squares, whose markers are numbered on from one to "
        "the next, as --print-board writes them (default: 1)",
    )  # fmt: skip


def _lengths(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no wand; expected M or M,M") from None


def _squares(text: str) -> tuple[int, int]:
    try:
        columns, rows = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no board; expected as 7x5") from None
    return columns, rows

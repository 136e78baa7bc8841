"""The flags of `psfs mesh`."""

from __future__ import annotations

import argparse

from psfs.cli.commandline import (
    add_device_flag,
    add_output_flag,
    add_overwrite_flag,
    add_run_folder,
)
from psfs.mesh.config import FORMATS, SMOOTHING

#: Definition of the figures that --check writes.
DEFINITION = (
    "IoU of the projected mesh (pixels whose centre's ray meets it) with the frame's own "
    "silhouette, which psfs check defines"
)


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    what = parser.description
    parser.description = (
        f"{what}, coloured where the clouds are. The probability is computed again from the "
        "frames' pictures. PLY and OBJ: metres, Z up; GLB: metres, Y up."
    )
    add_run_folder(parser)
    parser.add_argument(
        "--frame",
        type=_frame,
        metavar="N|all",
        help="frame to mesh (default: the first that is not empty)",
    )
    add_output_flag(
        parser,
        "file, or folder for --frame all (default: in OUT/meshes)",
        metavar="PATH",
        required=False,
    )
    add_overwrite_flag(parser)
    parser.add_argument("--format", choices=FORMATS, help="default: the output's suffix, or ply")
    parser.add_argument(
        "--smooth",
        type=int,
        default=SMOOTHING,
        metavar="N",
        help=f"smoothing steps, which do not shrink (default {SMOOTHING}; 0: none)",
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help=f"say whether the mesh is watertight, and the {DEFINITION}; "
        "writes OUT/mesh_check.json",
    )
    add_device_flag(parser)


def _frame(text: str) -> int | str:
    try:
        return text if text == "all" else int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no frame; expected a number or all"
        ) from None

"""The flags of `psfs view`."""

from __future__ import annotations

import argparse
from pathlib import Path

from psfs.cli.commandline import add_device_flag, add_overwrite_flag, add_run_folder
from psfs.cli.flags.page import add_page_flags


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_run_folder(parser)
    add_view_flags(parser)


def add_view_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags that `psfs.cli.view` needs, but the folder."""
    what = (parser.description or "").removesuffix(".")
    parser.description = (
        f"{what}. Keys of the page: space plays or pauses, J and L step, Home and End, Page Up and "
        "Page Down change the speed, 1 to 9 show and hide, V changes the colours, R looks from the "
        "start, I is dark or light; the arrows, W, A, S, D, Q and E move the view."
    )
    parser.add_argument(
        "--frame",
        type=int,
        metavar="N",
        help="frame to show (default: the first that is not empty)",
    )
    parser.add_argument("--mesh", action="store_true", help="show the surfaces of psfs mesh")
    parser.add_argument("--png", type=Path, metavar="FILE", help="write a picture, open no page")
    add_page_flags(parser)
    add_overwrite_flag(parser)
    add_device_flag(parser)

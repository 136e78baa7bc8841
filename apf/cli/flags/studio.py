"""The flags of `apf studio`."""

from __future__ import annotations

import argparse
from pathlib import Path

from psfs.cli.commandline import add_device_flag
from psfs.cli.flags.page import add_page_flags


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    parser.add_argument(
        "folder",
        type=Path,
        nargs="?",
        default=Path(),
        metavar="FOLDER",
        help="a take, results of apf track or psfs reconstruct, or a folder of these; the page "
        "reads nothing outside of it (default: the current folder)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("results"),
        metavar="OUT",
        help="folder for runs that the page starts, each in its own (default: %(default)s)",
    )
    parser.add_argument(
        "--captures",
        nargs="+",
        metavar="C",
        help="show these cameras live, to calibrate and film with: USB numbers, URLs or videos",
    )
    add_page_flags(parser)
    add_device_flag(parser)

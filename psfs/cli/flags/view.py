"""The flags of `psfs view`."""

from __future__ import annotations

import argparse
from pathlib import Path

from psfs.cli.commandline import add_device_flag, add_overwrite_flag, add_run_folder
from psfs.mesh.keys import KEYS


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_view_flags(parser)


def add_view_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags that `psfs.cli.view.view_run` needs."""
    what = (parser.description or "").removesuffix(".")
    keys = ", ".join(f"{key} {what}" for key, what in KEYS.items())
    parser.description = f"{what}. Keys of the window: {keys}, 1 to 9 show and hide."
    add_run_folder(parser)
    parser.add_argument(
        "--frame",
        type=int,
        metavar="N",
        help="frame to show (default: the first that is not empty)",
    )
    parser.add_argument("--mesh", action="store_true", help="show the surfaces of psfs mesh")
    parser.add_argument("--png", type=Path, metavar="FILE", help="write a picture, open no window")
    add_overwrite_flag(parser)
    add_device_flag(parser)

"""The flags of `apf demo`."""

from __future__ import annotations

import argparse
from pathlib import Path

from apf.synthetic.config import SceneConfig
from psfs.cli.commandline import add_device_flag, add_output_flag
from psfs.cli.setting_flags import add_setting_flags


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_output_flag(parser, metavar="FOLDER", required=False, default=Path("demo"))
    add_setting_flags(parser, SceneConfig, only=("frames", "cameras"), fill=True)
    parser.add_argument(
        "--open", action="store_true", help="open the report in a browser at the end"
    )
    add_device_flag(parser)

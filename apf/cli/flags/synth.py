"""The flags of `apf synth`."""

from __future__ import annotations

import argparse

from apf.synthetic.config import SceneConfig
from psfs.cli.commandline import add_device_flag, add_output_flag
from psfs.cli.setting_flags import add_setting_flags


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    add_output_flag(parser, metavar="FOLDER")
    add_setting_flags(parser, SceneConfig, fill=True)
    parser.add_argument(
        "--size",
        type=image_size,
        default="x".join(map(str, SceneConfig().size)),
        metavar="WxH",
        help="width and height of the pictures, px (default: %(default)s)",
    )
    add_device_flag(parser)


def image_size(text: str) -> tuple[int, int]:
    """Parse `640x480` to (640, 480) (argparse type)."""
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no picture size; expected WxH, such as 640x480"
        ) from None
    return width, height

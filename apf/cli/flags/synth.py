"""The flags of `apf synth`."""

from __future__ import annotations

import argparse
from pathlib import Path

from apf.synthetic.scene import SceneConfig
from psfs.cli.commandline import add_device_flag


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this command."""
    default = SceneConfig()
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="FOLDER")
    parser.add_argument("--cameras", type=int, default=default.cameras, metavar="N")
    parser.add_argument("--frames", type=int, default=default.frames, metavar="N")
    parser.add_argument("--fps", type=float, default=default.fps)
    parser.add_argument(
        "--size", type=image_size, default="x".join(map(str, default.size)), metavar="WxH"
    )
    parser.add_argument("--seed", type=int, default=default.seed)
    parser.add_argument(
        "--noise", type=float, default=default.noise, help="sigma of the sensor, grey levels"
    )
    parser.add_argument("--height", type=float, default=default.height, help="stature, m")
    add_device_flag(parser)


def image_size(text: str) -> tuple[int, int]:
    """`640x480` as (640, 480) (argparse type)."""
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no picture size; expected WxH, such as 640x480"
        ) from None
    return width, height

"""`apf synth`: a synthetic walker in a room, with exact truth."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path

from apf.synthetic.generate import generate
from apf.synthetic.scene import SceneConfig
from cl import select_device
from psfs.cli.commandline import add_command, add_device_flag, progress_bar, stdout
from psfs.cli.settings import write_settings
from psfs.common.outputs import output_folder


def register(commands: argparse._SubParsersAction) -> None:
    parser = add_command(
        commands, "synth", run, "Make a synthetic sequence of a person walking in a room."
    )
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


def run(args: argparse.Namespace) -> None:
    config = SceneConfig(
        cameras=args.cameras,
        frames=args.frames,
        fps=args.fps,
        size=args.size,
        seed=args.seed,
        noise=args.noise,
        height=args.height,
    )
    device = select_device(args.device)
    with output_folder(args.output, args.parser.prog), ExitStack() as stack:
        bar = progress_bar()
        task = bar.add_task("rendering", total=config.frames)

        def advance(done: int, _: int) -> None:
            if done == 1:  # not before: an error must stay a single line
                stack.enter_context(bar)
            bar.update(task, completed=done)

        generate(args.output, config, device, advance)
        write_settings(args.output, args)
    stdout.print(
        f"{args.output}: {config.frames} frames of {config.cameras} cameras at {config.fps:g} fps"
    )

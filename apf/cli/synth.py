"""`apf synth`: generate a synthetic walker in a room, with exact truth."""

from __future__ import annotations

import argparse
from contextlib import ExitStack

from apf.synthetic.config import SceneConfig
from apf.synthetic.generate import generate
from cl import select_device
from psfs.cli.commandline import progress_bar, stdout
from psfs.cli.setting_flags import with_flags
from psfs.cli.settings import write_settings
from psfs.common.outputs import output_folder


def run(args: argparse.Namespace) -> None:
    config = with_flags(SceneConfig(size=args.size), args)
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
    who = f"{config.people} people, " if config.people > 1 else ""
    stdout.print(
        f"{args.output}: {who}{config.frames} frames of {config.cameras} cameras "
        f"at {config.fps:g} fps"
    )

"""`apf synth`: generate a synthetic walker in a room, with exact truth."""

from __future__ import annotations

from contextlib import ExitStack

from apf.request import SynthRequest
from apf.synthetic.generate import generate
from cl import select_device
from psfs.cli.commandline import progress_bar, stdout
from psfs.common.outputs import output_folder
from psfs.common.requests import write_settings


def run(request: SynthRequest) -> None:
    config = request.scene
    device = select_device(request.device)
    with output_folder(request.output, request.COMMAND), ExitStack() as stack:
        bar = progress_bar()
        task = bar.add_task("rendering", total=config.frames)

        def advance(done: int, _: int) -> None:
            if done == 1:  # not before: an error must stay a single line
                stack.enter_context(bar)
            bar.update(task, completed=done)

        generate(request.output, config, device, advance)
        write_settings(request.output, request)
    who = f"{config.people} people, " if config.people > 1 else ""
    stdout.print(
        f"{request.output}: {who}{config.frames} frames of {config.cameras} cameras "
        f"at {config.fps:g} fps"
    )

"""`apf synth`: generate a synthetic walker in a room, with exact truth."""

from __future__ import annotations

from apf.request import SynthRequest
from apf.synthetic.generate import generate
from cl import select_device
from psfs.cli.commandline import progress_bar, stdout
from psfs.common.outputs import output_folder
from psfs.common.requests import write_settings


def run(request: SynthRequest) -> None:
    config = request.scene
    device = select_device(request.device)
    with output_folder(request.output, request.COMMAND):
        with progress_bar() as bar:
            task = bar.add_task("rendering", total=config.frames)
            generate(
                request.output, config, device, lambda done, _: bar.update(task, completed=done)
            )
        write_settings(request.output, request)
    who = f"{config.people} people, " if config.people > 1 else ""
    stdout.print(
        f"{request.output}: {who}{config.frames} frames of {config.cameras} cameras "
        f"at {config.fps:g} fps"
    )

"""`psfs view OUT`: look at the voxel clouds."""

from __future__ import annotations

import argparse
from pathlib import Path

from cl import UserError
from psfs.commandline import add_command, stdout
from psfs.preview import preview, write_picture
from psfs.runs import Run
from psfs.viewer import has_display, show


def register(commands: argparse._SubParsersAction) -> None:
    help = "show the voxel clouds in a window, or write a picture where there is no display"
    parser = add_command(commands, "view", _run, help=help)
    parser.add_argument("out", metavar="OUT", type=Path, help="output folder of psfs reconstruct")
    parser.add_argument("--frame", type=int, metavar="N", help="frame to show (default: the first)")
    parser.add_argument("--png", type=Path, metavar="FILE", help="write a picture, open no window")


def _run(args: argparse.Namespace) -> None:
    run = Run.open(args.out)
    if not run.indices:
        raise UserError(f"{args.out}: holds no reconstructed frame; expected at least one")
    frame = run.indices[0] if args.frame is None else args.frame
    if frame not in run.indices:
        raise UserError(
            f"--frame {frame}: {args.out} holds frames {run.indices[0]} to {run.indices[-1]}"
        )
    sequence = run.sequence()
    if args.png is None and has_display():
        show(run, sequence.rig, frame)
        return
    path = args.png or args.out / f"view_{frame:06d}.png"
    title = f"{sequence.name}, frame {frame}"
    write_picture(path, preview(run.cloud(frame), sequence.rig, sequence.read(frame), title))
    stdout.print(f"wrote {path}", soft_wrap=True)

"""`apf smooth`: a track without jitter."""

from __future__ import annotations

import argparse
from pathlib import Path

from apf.cli.takes.opened_track import add_smoothing_flags, opened_track
from apf.cli.track import RESULTS, write_files
from apf.tracking.smoothing import SmoothingConfig, smoothed
from cl import InputError
from psfs.cli.commandline import add_command, stdout
from psfs.cli.settings import write_settings
from psfs.common.outputs import output_folder


def register(commands: argparse._SubParsersAction) -> None:
    parser = add_command(commands, "smooth", run, "Smooth a track in time, after it was tracked.")
    parser.add_argument("track", type=Path, metavar="TRACK", help="folder that `apf track` wrote")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT")
    add_smoothing_flags(parser)
    parser.add_argument(
        "--lag",
        type=int,
        metavar="FRAMES",
        help="look so many frames ahead, as a program that runs live could "
        "(default: the whole sequence)",
    )


def run(args: argparse.Namespace) -> None:
    config = SmoothingConfig(cutoff=args.cutoff, lag=args.lag)
    folder = args.track if args.track.is_dir() else args.track.parent
    inputs = [folder, *([args.body] if args.body else [])]
    with output_folder(args.output, args.parser.prog, inputs, RESULTS):
        _smooth(args, config)


def _smooth(args: argparse.Namespace, config: SmoothingConfig) -> None:
    track = opened_track(args)
    try:
        track = smoothed(track, config)
    except InputError as error:
        raise InputError(f"{args.track}: {error}") from None
    write_files(args.output, track, track.its_body)
    write_settings(args.output, args)
    lost = int(track.lost.sum())
    note = f"; {lost} lost frames left as they were" if lost else ""
    stdout.print(f"{len(track)} frames smoothed: {args.output}{note}", soft_wrap=True)

"""`apf smooth`: a track without jitter."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from apf.body import load_body
from apf.cli.track import RESULTS, write_files
from apf.tracking.smoothing import SmoothingConfig, smoothed
from apf.tracking.track import Track
from cl import InputError
from psfs.cli.commandline import add_command, stdout
from psfs.cli.settings import write_settings
from psfs.common.outputs import output_folder


def register(commands: argparse._SubParsersAction) -> None:
    parser = add_command(commands, "smooth", run, "Smooth a track in time, after it was tracked.")
    parser.add_argument("track", type=Path, metavar="TRACK", help="folder that `apf track` wrote")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT")
    default = SmoothingConfig()
    parser.add_argument(
        "--cutoff",
        type=float,
        default=default.cutoff,
        metavar="HZ",
        help="motion this fast keeps half of its amplitude (default: %(default)g)",
    )
    parser.add_argument(
        "--lag",
        type=int,
        metavar="FRAMES",
        help="look so many frames ahead, as a program that runs live could "
        "(default: the whole sequence)",
    )
    parser.add_argument(
        "--body", type=Path, metavar="B", help="body model (default: that of the track)"
    )


def run(args: argparse.Namespace) -> None:
    config = SmoothingConfig(args.cutoff, args.lag)
    folder = args.track if args.track.is_dir() else args.track.parent
    inputs = [folder, *([args.body] if args.body else [])]
    with output_folder(args.output, args.parser.prog, inputs, RESULTS):
        _smooth(args, config)


def _smooth(args: argparse.Namespace, config: SmoothingConfig) -> None:
    track = Track.open(args.track)
    try:
        if args.body is not None:
            track = replace(track, body=load_body(args.body))
        track = smoothed(track, config)
    except InputError as error:
        raise InputError(f"{args.track}: {error}") from None
    write_files(args.output, track, track.its_body)
    write_settings(args.output, args)
    lost = int(track.lost.sum())
    note = f"; {lost} lost frames left as they were" if lost else ""
    stdout.print(f"{len(track)} frames smoothed: {args.output}{note}", soft_wrap=True)

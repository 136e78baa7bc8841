"""`apf smooth`: remove jitter from a track."""

from __future__ import annotations

import argparse

from apf.cli.takes.opened_track import open_given_track
from apf.cli.track import RESULTS, write_files
from apf.tracking.config import SmoothingConfig
from apf.tracking.smoothing import smooth_track
from cl import InputError
from psfs.cli.commandline import stdout
from psfs.cli.setting_flags import with_flags
from psfs.cli.settings import write_settings
from psfs.common.outputs import output_folder


def run(args: argparse.Namespace) -> None:
    config = with_flags(SmoothingConfig(), args)
    folder = args.track if args.track.is_dir() else args.track.parent
    inputs = [folder, *([args.body] if args.body else [])]
    with output_folder(args.output, args.parser.prog, inputs, RESULTS):
        _smooth(args, config)


def _smooth(args: argparse.Namespace, config: SmoothingConfig) -> None:
    track = open_given_track(args)
    try:
        track = smooth_track(track, config)
    except InputError as error:
        raise InputError(f"{args.track}: {error}") from None
    write_files(args.output, track, track.its_body)
    write_settings(args.output, args)
    lost = int(track.lost.sum())
    note = f"; {lost} lost frames left as they were" if lost else ""
    stdout.print(f"{len(track)} frames smoothed: {args.output}{note}", soft_wrap=True)

"""`apf smooth`: remove jitter from a track."""

from __future__ import annotations

import argparse
from dataclasses import replace

from apf.cli.takes.opened_track import open_given_track
from apf.cli.takes.results import RESULTS, write_files
from apf.tracking.config import SmoothingConfig
from apf.tracking.people import PeopleTracks, holds_people, person_folder
from apf.tracking.smoothing import smooth_track
from apf.tracking.track import Track
from cl import InputError
from psfs.cli.commandline import stdout
from psfs.cli.setting_flags import with_flags
from psfs.cli.settings import refuse_unused, write_settings
from psfs.common.outputs import output_folder


def run(args: argparse.Namespace) -> None:
    config = with_flags(SmoothingConfig(), args)
    folder = args.track if args.track.is_dir() else args.track.parent
    inputs = [folder, *([args.body] if args.body else [])]
    with output_folder(args.output, args.parser.prog, inputs, RESULTS):
        if holds_people(args.track):
            _smooth_people(args, config)
        else:
            _smooth(args, config)
        write_settings(args.output, args)


def _smooth_people(args: argparse.Namespace, config: SmoothingConfig) -> None:
    """Smooth each person's track into a folder of their own, and write people.json."""
    refuse_unused(args, ["body"], "applies only to one person; expected none with several")
    tracks, smoothed = PeopleTracks.open(args.track), []
    for number in range(1, len(tracks) + 1):
        own, into = (person_folder(of, number) for of in (args.track, args.output))
        into.mkdir(parents=True, exist_ok=True)
        one = argparse.Namespace(**{**vars(args), "track": own, "output": into})
        smoothed.append(_smooth(one, config))
    replace(tracks, tracks=tuple(smoothed)).save_list(args.output)


def _smooth(args: argparse.Namespace, config: SmoothingConfig) -> Track:
    track = open_given_track(args)
    try:
        track = smooth_track(track, config)
    except InputError as error:
        raise InputError(f"{args.track}: {error}") from None
    write_files(args.output, track, track.its_body)
    lost = int(track.lost.sum())
    note = f"; {lost} lost frames left as they were" if lost else ""
    stdout.print(f"{len(track)} frames smoothed: {args.output}{note}", soft_wrap=True)
    return track

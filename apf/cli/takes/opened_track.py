"""A track that is given to a command, with its body; how it is smoothed."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from apf.body import load_body
from apf.tracking.smoothing import SmoothingConfig
from apf.tracking.track import Track
from cl import InputError


def add_smoothing_flags(parser: argparse.ArgumentParser) -> None:
    """Add --cutoff and --body."""
    parser.add_argument(
        "--cutoff",
        type=float,
        default=SmoothingConfig().cutoff,
        metavar="HZ",
        help="smoothing: motion this fast keeps half of its amplitude (default: %(default)g)",
    )
    parser.add_argument(
        "--body", type=Path, metavar="B", help="body model (default: that of the track)"
    )


def opened_track(args: argparse.Namespace) -> Track:
    """Return the track at `args.track`, with the body of `--body` where that is given. Raises
    InputError, also where the track holds no body and needs one."""
    track = Track.open(args.track)
    if not len(track):
        raise InputError(f"{args.track}: holds no tracked frame; expected at least one")
    try:
        if args.body is not None:
            track = replace(track, body=load_body(args.body))
        if track.dof_names:
            _ = track.its_body
    except InputError as error:
        raise InputError(f"{args.track}: {error}") from None
    return track

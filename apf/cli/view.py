"""`apf view OUT`: a page in the browser that plays a track, or a track in stored voxels."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import closing
from functools import lru_cache, partial

import numpy as np

from apf.cli.takes.opened_track import open_given_track
from apf.studio.folders import find_kind
from apf.studio.opened import OpenedTracks, add_tracks, open_track, read_seen_frames
from apf.studio.watch import TrackWatch
from apf.tracking.people import list_people
from cl import InputError, select_device
from psfs.cli.view import make_mesher, open_folder, show_page, write_view
from psfs.cli.view import run as run_voxels
from psfs.page.opened import open_voxels


def run(args: argparse.Namespace) -> None:
    if args.track is not None:
        people = list_people(args.track) or [args.track]
        tracks = {path.name: open_given_track(args, path) for path in people}
        seen = read_seen_frames(args.track)
        run, frame = open_folder(args)
        mesher = make_mesher(args, run) if args.png is None else None
        voxels = partial(open_voxels, args.out, mesher)
        _view(args, lambda known: add_tracks(voxels(), tracks, seen), frame)
    elif find_kind(args.out) == "track" or next(args.out.glob("**/seed*/track.npz"), None):
        if args.mesh:
            what = f"{args.out} is a track, without clouds"
            raise InputError(f"--mesh: {what}; expected a run of psfs reconstruct")
        make_device = lru_cache(1)(partial(select_device, args.device))
        _view(args, partial(open_track, args.out, make_device), args.frame)
    else:
        run_voxels(args)


def _view(
    args: argparse.Namespace,
    open_run: Callable[[Callable[[int], object]], OpenedTracks],
    frame: int | None,
) -> None:
    """Show a run on a page or, with --png, write a frame's pictures with the body."""
    if args.png is None:
        show_page(args, open_run, frame, TrackWatch)
        return
    with closing(open_run(lambda frame: None)) as opened:
        sequence, shown = opened.sequence, int(opened.frames[0]) if frame is None else frame
        if sequence is None:
            raise InputError(f"{args.out}: {'; '.join(opened.remarks)}; expected its footage")
        if not any(shown in figure.rows for figure in opened.figures.values()):
            raise InputError(f"{args.track or args.out}: frame {shown} was not tracked")

        def draw() -> np.ndarray:
            return opened.draw(sequence.read(shown), None)

        write_view(args, sequence, draw)

"""`apf track --corrections`: a track with corrections by hand, parts of it tracked again."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from apf.cli.takes.job import TrackJob
from apf.report.summary import read_summary, read_tracked_grid
from apf.tracking.correction import Corrections, read_corrections
from apf.tracking.retracking import Retracking, apply_corrections
from apf.tracking.take import Take
from apf.tracking.track import Track
from cl import InputError
from psfs.cameras.names import join_names
from psfs.cli.settings import refuse_unused
from psfs.common.files import name_file_in_errors
from psfs.session import Session

#: Flags of tracks that cannot be corrected.
_REFUSED = ("seeds", "keypoints")


@dataclass(frozen=True, eq=False)
class CorrectedTrack:
    """Corrections, and the track that they correct."""

    corrections: Corrections
    track: Track


def read_corrections_flag(args: argparse.Namespace) -> CorrectedTrack | None:
    """Return the corrections that --corrections names, and their track; None without the flag.
    Raises InputError, or MissingFileError."""
    if getattr(args, "corrections", None) is None:
        return None
    refuse_unused(
        args, _REFUSED, "applies only to another kind of track; expected none with --corrections"
    )
    if args.people not in ("auto", "1"):
        raise InputError(f"--people is {args.people}; expected 1 with --corrections")
    corrections = read_corrections(args.corrections)
    track = Track.open(corrections.track)
    try:
        corrections.check(track)
        _ = track.its_body
    except InputError as error:
        raise InputError(f"{args.corrections}: {error}") from None
    summary = read_summary(corrections.track)
    if summary.get("people", 1) > 1:
        raise InputError(
            f"{corrections.track}: one of {summary['people']} people; expected a track of one"
        )
    if track.smoothing is not None:
        raise InputError(f"{corrections.track}: is smoothed; expected the track as it was tracked")
    if args.output.resolve() == corrections.track.resolve():
        raise InputError(f"{args.output}: holds the track; expected another folder for the new one")
    return CorrectedTrack(corrections, track)


def _check_take(folder: Path, session: Session) -> None:
    """Raise InputError unless the cameras of a track's take are among the session's."""
    tracked = read_summary(folder)["sequence"].get("cameras") or []
    missing = [name for name in tracked if name not in session.sequence.rig.names]
    if missing:
        raise InputError(
            f"was tracked by cameras that {session.sequence.name} lacks ({join_names(missing)}); "
            "expected the take of the track"
        )


def track_with_corrections(
    job: TrackJob, session: Session, given: CorrectedTrack, progress: Callable[[str], object]
) -> Take:
    """Return a take whose track is the given one with its corrections applied."""
    with name_file_in_errors(given.corrections.track):
        _check_take(given.corrections.track, session)
        grid = read_tracked_grid(given.track)
        if job.method.uses_voxels and grid is None:
            raise InputError("was not tracked in voxels; expected so")
    if grid is not None:
        given.corrections.check_places(grid)
    task, began = Retracking(session, grid, given.track, job.method), time.perf_counter()
    track = apply_corrections(task, given.corrections, progress)
    seconds = time.perf_counter() - began
    return Take(session.sequence, track.its_body, track.poses[0], None, [track], seconds)

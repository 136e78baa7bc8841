"""Read the tracks that are given to a command, with their bodies."""

from __future__ import annotations

from pathlib import Path

from apf.request import ExportRequest, SmoothRequest
from apf.tracking.people import PeopleTracks
from cl import InputError
from psfs.common.files import name_file_in_errors


def open_given_tracks(path: Path, cutoff: float | None = None) -> PeopleTracks:
    """Return the tracks of everybody at `path`. cutoff: of the smoothing, Hz, if it is stated.
    Raises InputError, also for a track of no frame, and of a body that it does not hold."""
    tracks = PeopleTracks.open(path)
    for track in tracks:
        if not len(track):
            raise InputError(f"{path}: holds no tracked frame; expected at least one")
        if cutoff is not None and cutoff >= track.fps / 2:
            raise InputError(
                f"--cutoff is {cutoff:g} Hz, which smooths nothing; expected less than half of "
                f"the track's {track.fps:g} frames per second"
            )
        with name_file_in_errors(path):
            _ = track.its_body if track.dof_names else None
    return tracks


def stated_cutoff(request: ExportRequest | SmoothRequest) -> float | None:
    """Return the cutoff, Hz, that a request states; None for the default."""
    return request.smoothing.cutoff if "cutoff" in request.chosen else None

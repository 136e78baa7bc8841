"""Read the tracks that are given to a command, with their bodies."""

from __future__ import annotations

from apf.request import ExportRequest, RenderRequest, SmoothRequest
from apf.tracking.people import PeopleTracks
from cl import InputError
from psfs.common.files import name_file_in_errors


def open_given_tracks(request: ExportRequest | RenderRequest | SmoothRequest) -> PeopleTracks:
    """Return the tracks of everybody that a request names. Raises InputError, also for a track of
    no frame, one that the stated cutoff does not smooth, and of a body that it does not hold."""
    path, cutoff = request.track, None
    if not isinstance(request, RenderRequest) and "cutoff" in request.chosen:
        cutoff = request.smoothing.cutoff
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

"""`apf smooth`: remove jitter from a track."""

from __future__ import annotations

from dataclasses import replace

from apf.cli.opened_track import open_given_track, stated_cutoff
from apf.request import SmoothRequest
from apf.takes.results import RESULTS, write_files
from apf.tracking.config import SmoothingConfig
from apf.tracking.people import PeopleTracks, holds_people, person_folder
from apf.tracking.smoothing import smooth_track
from apf.tracking.track import Track
from cl import InputError
from psfs.cli.commandline import stdout
from psfs.common.outputs import output_folder
from psfs.common.requests import write_settings


def run(request: SmoothRequest) -> None:
    config = request.smoothing
    folder = request.track if request.track.is_dir() else request.track.parent
    inputs = [folder, *([request.body] if request.body else [])]
    with output_folder(request.output, request.COMMAND, inputs, RESULTS):
        if holds_people(request.track):
            _smooth_people(request, config)
        else:
            _smooth(request, config)
        write_settings(request.output, request)


def _smooth_people(request: SmoothRequest, config: SmoothingConfig) -> None:
    """Smooth each person's track into a folder of their own, and write people.json."""
    request.refuse(["body"], "applies only to one person; expected none with several")
    tracks, smoothed = PeopleTracks.open(request.track), []
    for number in range(1, len(tracks) + 1):
        own, into = (person_folder(of, number) for of in (request.track, request.output))
        into.mkdir(parents=True, exist_ok=True)
        one = request.replace(track=own, output=into)
        smoothed.append(_smooth(one, config))
    replace(tracks, tracks=tuple(smoothed)).save_list(request.output)


def _smooth(request: SmoothRequest, config: SmoothingConfig) -> Track:
    track = open_given_track(request.track, request.body, stated_cutoff(request))
    try:
        track = smooth_track(track, config)
    except InputError as error:
        raise InputError(f"{request.track}: {error}") from None
    write_files(request.output, track, track.its_body)
    lost = int(track.lost.sum())
    note = f"; {lost} lost frames left as they were" if lost else ""
    stdout.print(f"{len(track)} frames smoothed: {request.output}{note}")
    return track

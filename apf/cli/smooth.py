"""`apf smooth`: remove jitter from a track."""

from __future__ import annotations

from dataclasses import replace

from apf.cli.opened_track import open_given_tracks
from apf.request import SmoothRequest
from apf.takes.results import RESULTS, write_people
from apf.tracking.smoothing import smooth_track
from psfs.cli.commandline import stdout
from psfs.common.files import name_file_in_errors
from psfs.common.outputs import output_folder
from psfs.common.requests import write_settings


def run(request: SmoothRequest) -> None:
    folder = request.track if request.track.is_dir() else request.track.parent
    with output_folder(request.output, request.COMMAND, [folder], RESULTS):
        tracks = open_given_tracks(request)
        with name_file_in_errors(request.track):
            smoothed = tuple(smooth_track(track, request.smoothing) for track in tracks)
        folders = write_people(request.output, replace(tracks, tracks=smoothed))
        for track, into in zip(smoothed, folders, strict=True):
            lost = int(track.lost.sum())
            note = f"; {lost} lost frames left as they were" if lost else ""
            stdout.print(f"{len(track)} frames smoothed: {into}{note}")
        write_settings(request.output, request)

"""`apf report`: report the quality of a track on a page with a player, the video and curves."""

from __future__ import annotations

from pathlib import Path

from apf.report import OVERLAY, PAGE
from apf.report.agreement import choose_rows
from apf.report.drawing import write_overlay
from apf.report.judged import judge_track, write_report
from apf.report.page import write_page
from apf.report.summary import SUMMARY, read_summary, read_tracked_config, read_tracked_grid
from apf.request import ReportRequest
from apf.tracking.people import PeopleTracks, holds_people, list_people
from apf.tracking.track import Track
from cl import InputError, select_device
from psfs.cli.commandline import progress_bar, stdout, warn
from psfs.common.files import name_file_in_errors
from psfs.common.outputs import output_folder
from psfs.output.reconstruction_folder import reopen_sequence
from psfs.session import Session, SessionSettings


def run(request: ReportRequest) -> None:
    folder: Path = request.track
    if not folder.is_dir():
        raise InputError(f"{folder}: no folder; expected one that `apf track` wrote")
    several = holds_people(folder)
    tracks = PeopleTracks.open(folder)
    people = list_people(folder) if several else [folder]
    for track in tracks:
        _check(track, folder)
    summary = read_summary(people[0])
    if not several and summary.get("people", 1) > 1:
        everybody = f"; expected all of them, {folder.parent}" * holds_people(folder.parent)
        raise InputError(
            f"{folder}: one of {summary['people']} people, whose silhouettes are separated only "
            f"while they are tracked, when apf track writes the page of each{everybody}"
        )
    last = int(tracks.frames.max())
    sequence = reopen_sequence(summary["sequence"], people[0] / SUMMARY, last)
    config = read_tracked_config(people[0], summary)
    video, quality = folder / OVERLAY, None
    draw = request.video and not video.exists()
    n_judged = 0 if several else len(choose_rows(len(tracks.frames)))
    with output_folder(folder, request.COMMAND, addition=True, replaces=True):
        with progress_bar() as bar:
            task = bar.add_task("checking", total=n_judged + draw * len(tracks.frames))

            def advance() -> None:
                bar.advance(task)

            if not several:
                session = Session(sequence, select_device(request.device), SessionSettings(config))
                doubts = summary.get("quality", {}).get("doubts", [])
                quality = judge_track(session, tracks[0], advance, doubts=doubts)
            if draw:
                write_overlay(video, sequence, tracks, advance)
        if quality is not None:
            write_report(folder, sequence.name, quality, summary)
        else:
            write_page(folder / PAGE, sequence.name, tracks, video)
    if quality is not None:
        for warning in summary["warnings"]:
            warn(warning, stdout)
        for line in quality.lines():
            stdout.print(line)
    else:
        for person in people:
            for line in read_summary(person).get("says", ()):
                stdout.print(f"{person.name}: {line}")
    stdout.print(f"wrote {folder / PAGE}")


def _check(track: Track, folder: Path) -> None:
    """Raise InputError for a track that cannot be judged."""
    if not track.dof_names:
        raise InputError(
            f"{folder}: triangulated points, which are not judged; expected the track of a body"
        )
    if not len(track):
        raise InputError(f"{folder}: holds no tracked frame; expected at least one")
    with name_file_in_errors(folder / "track.npz"):
        read_tracked_grid(track)  # before anything is written

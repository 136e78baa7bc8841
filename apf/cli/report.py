"""`apf report`: report the quality of a track on a page with a player, the video and curves."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from apf.report import OVERLAY, PAGE
from apf.report.agreement import choose_rows
from apf.report.drawing import write_overlay
from apf.report.judged import judge_track, write_report
from apf.report.page import write_page
from apf.report.summary import (
    open_tracked_sequence,
    read_summary,
    read_tracked_config,
    read_tracked_grid,
)
from apf.request import ReportRequest
from apf.tracking.people import PeopleTracks, holds_people, person_folder
from apf.tracking.track import Track
from cl import InputError, select_device
from psfs.cli.commandline import progress_bar, stdout, warn
from psfs.common.files import name_file_in_errors
from psfs.common.outputs import output_folder
from psfs.session import Session, SessionSettings


def run(request: ReportRequest) -> None:
    folder: Path = request.track
    if not folder.is_dir():
        raise InputError(f"{folder}: no folder; expected one that `apf track` wrote")
    if holds_people(folder):
        _run_people(request, folder)
        return
    track = Track.open(folder)
    _check_body(track, folder)
    summary = read_summary(folder)
    if not len(track):
        raise InputError(f"{folder}: holds no tracked frame; expected at least one")
    if summary.get("people", 1) > 1:
        everybody = f"; expected all of them, {folder.parent}" * holds_people(folder.parent)
        raise InputError(
            f"{folder}: one of {summary['people']} people, whose silhouettes are separated only "
            f"while they are tracked, when apf track writes the page of each{everybody}"
        )
    last = int(track.frames.max())
    with name_file_in_errors(folder / "track.npz"):
        read_tracked_grid(track)  # before anything is written
    sequence, config = (
        open_tracked_sequence(folder, summary, last),
        read_tracked_config(folder, summary),
    )
    session = Session(sequence, select_device(request.device), SessionSettings(config))
    draw = request.video and not (folder / OVERLAY).exists()
    with (
        output_folder(folder, request.COMMAND, addition=True, replaces=True),
        ExitStack() as stack,
    ):
        bar = progress_bar()
        steps = len(choose_rows(len(track))) + (len(track) if draw else 0)
        task = bar.add_task("checking", total=steps)

        def advance() -> None:
            if not bar.live.is_started:  # not before: an error must stay a single line
                stack.enter_context(bar)
            bar.advance(task)

        doubts = summary.get("quality", {}).get("doubts", [])
        quality = judge_track(session, track, advance, doubts=doubts)
        if draw:
            write_overlay(folder / OVERLAY, sequence, track, advance)
        stack.close()
        write_report(folder, sequence.name, quality, summary)
    for warning in summary["warnings"]:
        warn(warning, stdout)
    for line in quality.lines():
        stdout.print(line)
    stdout.print(f"wrote {folder / PAGE}")


def _check_body(track: Track, folder: Path) -> None:
    """Raise InputError for triangulated points."""
    if not track.dof_names:
        raise InputError(
            f"{folder}: triangulated points, which are not judged; expected the track of a body"
        )


def _run_people(request: ReportRequest, folder: Path) -> None:
    """Write the page of several people, and their overlay if it is missing."""
    tracks = PeopleTracks.open(folder)
    _check_body(tracks[0], folder)
    first = person_folder(folder, 1)
    summary, video = read_summary(first), folder / OVERLAY
    sequence = open_tracked_sequence(first, summary, int(tracks.frames.max()))
    with (
        output_folder(folder, request.COMMAND, addition=True, replaces=True),
        ExitStack() as stack,
    ):
        if request.video and not video.exists():
            bar = stack.enter_context(progress_bar())
            task = bar.add_task("overlay", total=len(tracks.frames))
            write_overlay(video, sequence, tracks, lambda: bar.advance(task))
        write_page(folder / PAGE, sequence.name, tracks, video)
    for number in range(1, len(tracks) + 1):
        own = person_folder(folder, number)
        for line in read_summary(own).get("says", ()):
            stdout.print(f"{own.name}: {line}")
    stdout.print(f"wrote {folder / PAGE}")

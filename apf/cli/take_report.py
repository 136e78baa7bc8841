"""Track a take with its progress and results on the terminal."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np

from apf.report import PAGE
from apf.request import TrackRequest
from apf.takes.job import list_inputs
from apf.takes.results import RESULTS, FinishedTake, Judgement, was_interrupted
from apf.takes.track import run_track
from apf.tracking.progress import StageProgress
from apf.tracking.take import Take
from apf.tracking.track import PEOPLE, spans
from cl import Device, InputError, NumpyDevice
from psfs.cli.commandline import stderr, stdout
from psfs.common.outputs import output_folder
from psfs.common.ranges import NAMED


def track_one(
    request: TrackRequest,
    device: Device | NumpyDevice,
    line: StageProgress,
    stop: Callable[[], object] = lambda: None,
) -> list[FinishedTake]:
    """Track one take, write its files and print the results. Return the take of each person.

    stop: called after tracking, before anything is printed. Raises UserError; raises
    KeyboardInterrupt after writing the track so far, if `line` raised one.
    """
    assert request.output is not None
    with output_folder(request.output, request.COMMAND, list_inputs(request), RESULTS) as out:
        everybody = run_track(request, device, line, out=out)
        stop()
        for done in everybody:
            done.raise_error()
            for judgement in done.judgements:
                print_outcome(judgement, done.n_frames)
            if done.interrupted:
                raise KeyboardInterrupt
            for text in describe_spread(done.take):
                stdout.print(text)
        if (request.output / PEOPLE).exists():
            page = PAGE if (request.output / PAGE).exists() else PEOPLE
            stdout.print(f"all people together: {request.output / page}")
    return everybody


def describe_spread(take: Take) -> list[str]:
    """Describe the differences between several runs and, if the truth is known, their errors."""
    tracks = take.tracks
    if len(tracks) == 1:
        return []
    from apf.evaluation.evaluate import evaluate  # which take a while to load
    from apf.evaluation.people import find_followed
    from apf.evaluation.truth import load_people_truth

    joints = np.stack([track.joints for track in tracks])
    away = 1000 * np.linalg.norm(joints - joints.mean(0), axis=-1)
    lines = [f"{len(tracks)} runs: joints lie {away.mean():.1f} mm from the runs' mean"]
    path = take.sequence.folder / "truth.npz"
    with suppress(InputError):  # there is none
        truth = load_people_truth(path)
        followed = truth[find_followed(tracks[0], truth)]
        errors = [1000 * evaluate(track, followed).mean_error for track in tracks]
        spread = f"{np.mean(errors):.1f} ± {np.std(errors, ddof=1):.1f} mm"
        lines.append(f"mean error: {spread}, {min(errors):.1f} to {max(errors):.1f}")
    return lines


def print_outcome(judgement: Judgement, n_frames: int) -> None:
    """Print the result of a track of which `n_frames` were requested: its quality, the frames to
    check, and the files that were written."""
    track, folder = judgement.quality.track, judgement.folder
    if was_interrupted(track, n_frames):
        lacking = "" if len(track) < n_frames else ", not all of them by every pass"
        stderr.print(
            f"{len(track)} of {n_frames} frames are in {folder}{lacking}; the same command tracks "
            "all again"
        )
        return
    stdout.print(f"{len(track)} frames tracked: {folder}")
    if len(track.restarts):
        stdout.print(
            f"found again by a new search in frames {spans(track.restarts.tolist(), NAMED)}"
        )
    for line in judgement.quality.lines():
        stdout.print(line)
    stdout.print(f"wrote {', '.join(judgement.files)}")

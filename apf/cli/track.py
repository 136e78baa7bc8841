"""`apf track`: estimate a skeleton per frame."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, closing

from apf.backend import check_renderer
from apf.cli.take_report import TakeLine, TakeReport, describe_spread, print_outcome
from apf.cli.triangulate import run_triangulate
from apf.report import PAGE
from apf.request import TrackRequest
from apf.takes.job import list_inputs, take_names
from apf.takes.results import RESULTS, FinishedTake
from apf.takes.track import check_request, run_track
from apf.tracking.batch import run_at_once
from apf.tracking.progress import StageProgress, make_stage_bar, show_bar
from apf.tracking.track import PEOPLE
from cl import Device, InputError, NumpyDevice, UserError, select_device
from psfs.cli.commandline import is_quiet, stderr, stdout
from psfs.common.outputs import output_folder


def run(request: TrackRequest) -> None:
    if request.triangulate:
        run_triangulate(request, take_names(request.folders))
        return
    check_request(request)
    if request.at_once is not None and request.at_once < 1:
        raise InputError(f"--at-once is {request.at_once}; expected at least 1")
    if len(request.folders) > 1:
        request.refuse(["corrections"], "applies only to one take; expected none with several")
        if request.init is not None:
            raise InputError("--init is the first pose of one take; expected none with several")
        _run_many(request)
        return
    request.refuse(["at_once"], "applies only to several takes; expected more than one")
    bar = make_stage_bar(stderr.console, is_quiet())
    line = TakeLine(bar)
    with ExitStack() as stack:
        stack.enter_context(show_bar(bar))
        device = select_device(request.device)
        check_renderer(device, request.method)
        track_one(request, device, line, stack.close)


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
            stdout.print(f"all people together: {request.output / page}", soft_wrap=True)
    return everybody


def _run_many(request: TrackRequest) -> None:
    """Track every folder into its own, several at a time; print a table of all, also of interrupted
    ones. Raises InputError if one failed."""
    names, output = take_names(request.folders), request.output
    assert output is not None
    device = select_device(request.device)
    check_renderer(device, request.method)
    report, bar = TakeReport(names), make_stage_bar(stderr.console, is_quiet())
    overall = bar.add_task("takes", total=len(names))

    def work(place: Device | NumpyDevice, number: int, check: Callable[[], None]) -> None:
        name = names[number]
        one = request.replace(folders=(request.folders[number],), output=output / name)
        with (
            closing(TakeLine(bar, name, check)) as line,
            output_folder(output / name, request.COMMAND, list_inputs(one), RESULTS) as out,
        ):
            for done in run_track(one, place, line, out=out):
                done.raise_error()
                spread = describe_spread(done.take)
                report.add_take(name, done.take, done.n_frames, done.judgements, spread)
                if done.interrupted:
                    raise KeyboardInterrupt

    try:
        with (
            output_folder(output, request.COMMAND, request.folders) as outer,
            bar,
            closing(run_at_once(device, work, len(names), request.at_once)) as outcomes,
        ):
            outer.begin()  # remove the results of an earlier single take
            for number, outcome in outcomes:
                if isinstance(outcome, UserError):
                    report.add_failure(names[number], outcome)
                stderr.print(report.line(names[number]), soft_wrap=True)
                done = len(report.rows)
                bar.update(overall, completed=done, description=f"takes {done}/{len(names)}")
    finally:
        report.show()
    if report.errors:
        failed = ", ".join(name for name in names if name in report.errors)
        raise InputError(f"{len(report.errors)} of {len(names)} takes failed: {failed}")

"""`apf track`: estimate a skeleton per frame."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from apf.api import load_template, read_given_start
from apf.backend import check_renderer
from apf.cli.first_pose import explain_failed_start, warn_of_doubts
from apf.cli.keypoints.flags import read_keypoints
from apf.cli.keypoints.triangulate import TRIANGULATE, run_triangulate
from apf.cli.takes.corrected import CorrectedTrack, read_corrections_flag, track_with_corrections
from apf.cli.takes.flags import check_flags
from apf.cli.takes.job import TrackJob, open_session, take_names
from apf.cli.takes.kept_parts import Keeper
from apf.cli.takes.people import Persons, find_persons, write_together
from apf.cli.takes.results import RESULTS, FinishedTake, finish_take, print_outcome, write_tracks
from apf.cli.takes.take_report import TakeLine, TakeReport, describe_spread
from apf.filters.method import Method
from apf.initialisation import StartError
from apf.report import PAGE
from apf.report.judged import keep_judged_frames
from apf.tracking.batch import run_at_once
from apf.tracking.progress import StageProgress
from apf.tracking.settings import GivenStart, TakeSettings
from apf.tracking.take import Take, check_cameras, track_take
from apf.tracking.track import PEOPLE
from cl import Device, InputError, NumpyDevice, UserError, select_device
from psfs.cli.commandline import progress_bar, stderr, stdout, warn
from psfs.cli.sequence_flags import (
    examine_footage,
    open_sequence,
    select_common_frames,
    select_frames,
)
from psfs.cli.settings import refuse_unused
from psfs.common.outputs import OutputFolder, output_folder
from psfs.diagnostics.examination import Examination
from psfs.sequence import Sequence


def run(args: argparse.Namespace) -> None:
    if args.method == TRIANGULATE:
        run_triangulate(args, take_names([Path(folder) for folder in args.folders]))
        return
    method = check_flags(args)
    if args.at_once is not None and args.at_once < 1:
        raise InputError(f"--at-once is {args.at_once}; expected at least 1")
    if len(args.folders) == 1:
        refuse_unused(args, ["at_once"], "applies only to several takes; expected more than one")
    if len(args.folders) > 1:
        refuse_unused(args, ["corrections"], "applies only to one take; expected none with several")
        _run_many(args, method)
        return
    device = select_device(args.device)
    check_renderer(device, method)
    bar = progress_bar()  # started by the first frame

    def stop() -> None:
        if bar.live.is_started:  # stopping prints a line
            bar.stop()

    track_one(args, device, TakeLine(bar), stop)


def track_one(
    args: argparse.Namespace,
    device: Device | NumpyDevice,
    line: StageProgress,
    before_words: Callable[[], object] = lambda: None,
) -> list[FinishedTake]:
    """Track one take, named by the flags, on `device`; write its files and print the results.
    Return the take of each person.

    before_words: called after the line has ended, before anything is printed. Raises UserError;
    raises KeyboardInterrupt after writing the track so far, if `line` raised one.
    """
    job = TrackJob.from_arguments(args, device, folder=args.folders[0])
    with output_folder(args.output, args.parser.prog, job.inputs, RESULTS) as out:
        try:
            everybody = _track_and_judge(out, job, line)
        finally:
            before_words()
        for done in everybody:
            done.raise_error()
            for judgement in done.judgements:
                print_outcome(judgement, done.n_frames)
            if done.interrupted:
                raise KeyboardInterrupt
            for line_of_spread in describe_spread(done.take):
                stdout.print(line_of_spread)
        if (args.output / PEOPLE).exists():
            page = PAGE if (args.output / PAGE).exists() else PEOPLE
            stdout.print(f"all people together: {args.output / page}", soft_wrap=True)
    return everybody


def _run_many(args: argparse.Namespace, method: Method) -> None:
    """Track every folder into its own, several at a time; print a table of all, also of interrupted
    ones. Raises InputError if one failed."""
    if args.init is not None:
        raise InputError("--init is the first pose of one take; expected none with several")
    names = take_names([Path(folder) for folder in args.folders])
    device = select_device(args.device)
    check_renderer(device, method)
    report, bar = TakeReport(names), progress_bar()
    overall = bar.add_task("takes", total=len(names))

    def work(own: Device | NumpyDevice, number: int, check: Callable[[], None]) -> None:
        name = names[number]
        job = TrackJob.from_arguments(
            args, own, folder=args.folders[number], output=args.output / name
        )
        with (
            closing(TakeLine(bar, name, check)) as line,
            output_folder(job.args.output, args.parser.prog, job.inputs, RESULTS) as out,
        ):
            for done in _track_and_judge(out, job, line):
                done.raise_error()
                spread = describe_spread(done.take)
                report.add_take(name, done.take, done.n_frames, done.judgements, spread)
                if done.interrupted:
                    raise KeyboardInterrupt

    folders = [Path(folder) for folder in args.folders]
    try:
        with (
            output_folder(args.output, args.parser.prog, folders) as outer,
            bar,
            closing(run_at_once(device, work, len(names), args.at_once)) as outcomes,
        ):
            outer.begin()  # remove the results of an earlier single take
            for number, outcome in outcomes:
                if isinstance(outcome, UserError):
                    report.add_failure(names[number], outcome)
                stderr.print(report.line(names[number]), soft_wrap=True)
                bar.advance(overall)
    finally:
        report.show()
    if report.errors:
        failed = ", ".join(name for name in names if name in report.errors)
        raise InputError(f"{len(report.errors)} of {len(names)} takes failed: {failed}")


def _track_and_judge(out: OutputFolder, job: TrackJob, line: StageProgress) -> list[FinishedTake]:
    """Run all stages of a take and write its files: of the only person, or of each of several."""
    args, opened = job.args, _open_sequence(out, job)
    first = select_frames(args, opened)[0]
    given = read_given_start(opened.folder, first, args.body, args.init, args.convention)
    corrected = read_corrections_flag(args)
    if job.method.uses_voxels:
        check_cameras(opened)
    # All files that flags name are read by now, before the diagnosis, which takes seconds.
    examination = _examine(job, opened)
    del opened  # free its frames: the examined sequence may have other cameras
    session = examination.session
    line.n_frames = len(select_common_frames(args, session.sequence))
    if corrected is not None:
        line.n_frames = len(corrected.track)
        return [_track_person(job, examination, None, line, corrected)]
    persons = find_persons(job, session, given, line) if line.n_frames else None
    if persons is None:
        return [_track_person(job, examination, given, line)]
    return _track_people(job, examination, persons, line)


def _track_people(
    job: TrackJob, examination: Examination, persons: Persons, line: StageProgress
) -> list[FinishedTake]:
    """Track each person and write their files. Who cannot be started is taken for an object,
    unless --people says how many there are."""
    done: list[FinishedTake] = []
    while len(done) < len(persons.sessions):
        number = len(done) + 1
        own_job, session = persons.job(job, number), persons.sessions[number - 1]
        line.begin_person(len(session.frames), number, len(persons.sessions))
        try:
            done.append(_track_person(own_job, replace(examination, session=session), None, line))
        except StartError as error:
            if job.args.people != "auto" or len(persons.sessions) == 1:
                raise
            warn(f"{error}; without a first pose it is left out, as an object")
            persons = persons.without(number)
            continue
        if done[-1].interrupted or done[-1].take.error is not None:
            break
    if done[0].folder != job.args.output:
        verdicts = [one.judgements[0].quality.verdict for one in done]
        whole = len(done) == len(persons.sessions) and not done[-1].interrupted
        if not whole:
            warn(f"tracking ended in person {len(done)} of {len(persons.sessions)}")
        tracks = persons.gather([one.take.tracks[0] for one in done], verdicts)
        write_together(job, tracks, examination.session.sequence, line if whole else None)
    return done


def _track_person(
    job: TrackJob,
    examination: Examination,
    given: GivenStart | None,
    line: StageProgress,
    corrected: CorrectedTrack | None = None,
) -> FinishedTake:
    """Track one person in a session, or correct their track, and write their files."""
    session = examination.session
    if job.method.uses_voxels and not job.args.no_report:
        keep_judged_frames(session)
    if corrected is not None:
        take = track_with_corrections(job, session, corrected, line)
    else:
        take = _track(job, examination, given, line)
    write_tracks(job, take)
    judgements = finish_take(job, examination, take, line)
    return FinishedTake(take, line.n_frames, job.args.output, judgements)


def _open_sequence(out: OutputFolder, job: TrackJob) -> Sequence:
    """Return the take's sequence, which keeps its frames in memory if they fit."""
    if job.method.uses_images:
        job.method.image.mesh(load_template(job.args.body)[0])  # check the mesh files early
    sequence = open_sequence(job.args)
    sequence.keep_frames()
    out.check_inputs(sequence.inputs)
    return sequence


def _examine(job: TrackJob, opened: Sequence) -> Examination:
    """Diagnose the footage, unless only keypoints are used."""
    session = open_session(job.args, opened, job.device)
    if job.method.objective == "keypoints":
        return Examination(session)
    return examine_footage(job.args, session, person=True)


def _track(
    job: TrackJob, examination: Examination, given: GivenStart | None, line: StageProgress
) -> Take:
    """Track a take."""
    args, session = job.args, examination.session
    sequence = session.sequence
    template, keep_shape = load_template(args.body)
    settings = TakeSettings(
        method=job.method,
        seeds=tuple(job.seeds),
        template=template,
        keep_shape=keep_shape,
        height=args.height,
        given=given,
        keypoints=job.keypoints or read_keypoints(args, sequence, examination.diagnosis),
    )
    number = job.of_people.get("person")
    with explain_failed_start(sequence, number):
        take = track_take(session, settings, line, Keeper(job.folders))
    if take.start is not None:
        warn_of_doubts(sequence, take.start, number)
    return take

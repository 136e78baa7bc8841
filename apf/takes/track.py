"""Run a request to track a take: the one way of API, commands, batches and studio."""

from __future__ import annotations

import time
from dataclasses import replace

from apf.initialisation.start import StartError
from apf.report.summary import read_summary, read_tracked_grid
from apf.request import TrackingRequest, TrackRequest
from apf.takes.job import TrackJob, list_seeds
from apf.takes.people import Persons, check_people, find_persons
from apf.takes.results import (
    FinishedTake,
    Keeper,
    finish_take,
    write_together,
    write_tracks,
)
from apf.takes.start import (
    check_start,
    explain_failed_start,
    load_template,
    read_given_start,
    warn_of_doubts,
)
from apf.tracking.progress import AGAIN, StageProgress
from apf.tracking.retracking import Corrections, Retracking, apply_corrections, read_corrections
from apf.tracking.settings import GivenStart, TakeSettings
from apf.tracking.take import (
    StartedTake,
    Take,
    check_cameras,
    choose_starts,
    complete_takes,
    start_take,
    track_again,
    track_first,
)
from apf.tracking.together import place_bodies
from apf.tracking.track import Track
from cl import Device, InputError, NumpyDevice
from psfs.cameras.names import join_names
from psfs.common.files import name_file_in_errors
from psfs.common.outputs import OutputFolder
from psfs.diagnostics.examination import Examination
from psfs.opening import (
    examine_footage,
    open_sequence,
    open_session,
    select_common_frames,
    select_frames,
)
from psfs.sequence import Sequence
from psfs.session import Session


def check_request(request: TrackingRequest) -> None:
    """Raise InputError for impossible values, and for flags that exclude each other."""
    list_seeds(request)
    check_people(request)
    check_start(request)


def run_track(
    request: TrackingRequest,
    device: Device | NumpyDevice,
    progress: StageProgress,
    *,
    sequence: Sequence | None = None,
    out: OutputFolder | None = None,
    why_one: str = "",
) -> list[FinishedTake]:
    """Track a take: open and examine its footage, find its people, track each, judge the tracks
    and write them into `request.output`, unless that is None. Return the take of each person.

    sequence: the opened footage; by default that of `request.folder`, whose frames are kept in
    memory if they fit. out: the folder of results, which must not hold what is read. why_one: why
    one person is tracked, with a warning if several are seen. An interrupt ends the tracks. Raises
    UserError; an error after the first frame becomes the `error` of the take.
    """
    method = request.method
    writes, back = request.output is not None, method.goes_back
    stated = request.init is not None or request.keypoints is not None
    left_out = {
        "overlay": not (writes and request.video), "checking": not (writes and request.report),
        "tracking back": not back, "fitting": not back, "completing": not back or stated,
        **dict.fromkeys(AGAIN, not back or stated),
    }  # fmt: skip
    is_gpu = isinstance(device, Device) and device.is_gpu
    progress.expect([stage for stage, out in left_out.items() if out], is_gpu)
    progress("opening")
    if method.uses_images:
        method.image.mesh(load_template(request.body)[0])  # check the mesh files early
    if sequence is None:
        sequence = open_sequence(request)
        sequence.keep_frames()
    if out is not None:
        out.check_inputs(sequence.inputs)
    chosen = select_frames(request.frames, sequence)
    progress.n_frames = len(chosen)
    given = read_given_start(
        sequence.folder, chosen[0], request.body, request.init, request.convention
    )
    corrected = _read_corrections(request)
    if method.uses_voxels:
        check_cameras(sequence)
    # All files that the request names are read by now, before the diagnosis, which takes seconds.
    session, remarks = open_session(request, sequence, device), list[str]()
    del sequence  # free its frames: the examined sequence may have other cameras
    examination = Examination(session)
    progress("examining")
    if method.objective != "keypoints":
        examination, request, remarks = examine_footage(
            request, session, progress.warn, person=True
        )
    session = examination.session
    job = TrackJob(request, device, progress, tuple(remarks), why_one=why_one)
    frames = select_common_frames(request.frames, session.sequence, progress.warn)
    progress.n_frames = len(frames)
    if corrected is not None:
        corrections, track = corrected
        progress.n_frames = len(track)
        _keep_judged(job, session)
        return [_finish(job, examination, _correct(job, session, corrections, track))]
    try:
        return _track_people(job, examination, find_persons(job, examination, given), given)
    except InputError as error:
        if examination.of_all is None:
            raise
        raise InputError(f"{error}; the likely cause: {examination.of_all}") from None


def _track_people(
    job: TrackJob, examination: Examination, persons: Persons, given: GivenStart | None
) -> list[FinishedTake]:
    """Track each person and write their files. Who cannot be started is taken for an object,
    unless the request says how many there are. given: the start of the only person."""
    progress = job.progress
    started: list[StartedTake] = []
    while len(started) < len(persons.everybody):
        number = len(started) + 1
        session = _begin_person(job, persons, number)
        try:
            started.append(_start(persons.job(job, number), session, given))
        except StartError as error:
            if job.request.people != "auto" or len(persons.everybody) == 1:
                raise
            progress.warn(f"{error}; without a first pose it is left out, as an object")
            persons = persons.without(number)
    started = choose_starts(started, lambda stage: progress("start"))
    keepers = list[Keeper | None]()
    for number, start in enumerate(started, start=1):
        person, session = persons.job(job, number), start.session
        if start.start is not None:
            whose = person.of_people.get("person")
            warn_of_doubts(session.sequence, start.start, progress.warn, whose)
        _keep_judged(job, session)
        keepers.append(Keeper(person.folders) if person.folders else None)
    if not persons.alone:
        progress.begin_everybody([len(start.session.frames) for start in started])
    takes = track_first(started, progress, keepers)
    place_bodies(started, takes)
    takes = track_again(started, takes, progress)
    if any(take.complete is not None for take in takes):
        progress("completing")
    done, takes = [], complete_takes(takes)
    for number, take in enumerate(takes, start=1):
        session = _begin_person(job, persons, number)
        done.append(_finish(persons.job(job, number), replace(examination, session=session), take))
    verdicts = [one.judgements[0].quality.verdict for one in done if one.judgements]
    tracks = persons.gather([take.tracks[0] for take in takes], verdicts)
    done = [replace(one, everybody=tracks) for one in done]
    if job.request.output is not None and done[0].folder != job.request.output:
        whole = len(done) == len(persons.everybody) and not done[-1].interrupted
        if not whole:
            progress.warn(f"tracking ended in person {len(done)} of {len(persons.everybody)}")
        write_together(job, tracks, examination.session.sequence, whole)
    return done


def _begin_person(job: TrackJob, persons: Persons, number: int) -> Session:
    """Return the session of a person, counted from 1, of whom progress is reported now."""
    session = persons.everybody[number - 1].session
    if not persons.alone:
        job.progress.begin_person(len(session.frames), number, len(persons.everybody))
    return session


def _keep_judged(job: TrackJob, session: Session) -> None:
    """Have the session keep the frames, as they are carved while the person is tracked, that are
    judged of the whole track."""
    request, frames = job.request, session.frames
    if request.method.uses_voxels and request.report and request.output is not None:
        from apf.report.agreement import choose_rows  # takes a while to load

        session.keep_carved([frames[int(row)] for row in choose_rows(len(frames))])


def _finish(job: TrackJob, examination: Examination, take: Take) -> FinishedTake:
    """Write the files of one person."""
    n_frames = job.progress.n_frames
    if job.request.output is None:
        return FinishedTake(take, n_frames, None, [])
    write_tracks(job, take)
    judgements = finish_take(job, examination, take)
    return FinishedTake(take, n_frames, job.request.output, judgements)


def _start(job: TrackJob, session: Session, given: GivenStart | None) -> StartedTake:
    """Find a person's body and first pose."""
    request, sequence = job.request, session.sequence
    template, keep_shape = load_template(request.body)
    settings = TakeSettings(
        method=request.method,
        seeds=tuple(list_seeds(request)),
        template=template,
        keep_shape=keep_shape,
        height=request.height,
        given=given,
        keypoints=job.keypoints,
    )
    number = job.of_people.get("person")
    with explain_failed_start(sequence, number):
        return start_take(session, settings, job.progress)


def _read_corrections(request: TrackingRequest) -> tuple[Corrections, Track] | None:
    """Return the corrections that a request names, and their track; None without any. Raises
    InputError, or MissingFileError."""
    if not isinstance(request, TrackRequest) or request.corrections is None:
        return None
    request.refuse(
        ("seeds", "keypoints"),
        "applies only to another kind of track; expected none with --corrections",
    )
    if request.people not in ("auto", 1):
        raise InputError(f"--people is {request.people}; expected 1 with --corrections")
    corrections = read_corrections(request.corrections)
    track = Track.open(corrections.track)
    with name_file_in_errors(request.corrections):
        corrections.check(track)
        _ = track.its_body
    summary = read_summary(corrections.track)
    if summary.get("people", 1) > 1:
        raise InputError(
            f"{corrections.track}: one of {summary['people']} people; expected a track of one"
        )
    if track.smoothing is not None:
        raise InputError(f"{corrections.track}: is smoothed; expected the track as it was tracked")
    if request.output is not None and request.output.resolve() == corrections.track.resolve():
        raise InputError(
            f"{request.output}: holds the track; expected another folder for the new one"
        )
    return corrections, track


def _correct(job: TrackJob, session: Session, corrections: Corrections, track: Track) -> Take:
    """Return a take whose track is the given one with its corrections applied."""
    with name_file_in_errors(corrections.track):
        tracked = read_summary(corrections.track)["sequence"].get("cameras") or []
        missing = [name for name in tracked if name not in session.sequence.rig.names]
        if missing:
            raise InputError(
                f"was tracked by cameras that {session.sequence.name} lacks "
                f"({join_names(missing)}); expected the take of the track"
            )
        grid = read_tracked_grid(track)
        if job.request.method.uses_voxels and grid is None:
            raise InputError("was not tracked in voxels; expected so")
    if grid is not None:
        corrections.check_places(grid)
    task, began = Retracking(session, grid, track, job.request.method), time.perf_counter()
    track = apply_corrections(task, corrections, job.progress)
    seconds = time.perf_counter() - began
    return Take(session.sequence, track.its_body, track.poses[0], None, [track], seconds)

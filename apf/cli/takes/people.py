"""The people of a take: whether there are several, and a session and a folder for each."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from apf.cli.keypoints.flags import (
    find_seen_frames,
    open_people_keypoints,
    read_people_keypoints,
)
from apf.cli.people_flag import people_number
from apf.cli.takes.job import TrackJob
from apf.filters.method import Method
from apf.keypoints import Keypoints
from apf.report import OVERLAY, PAGE
from apf.report.drawing import write_overlay
from apf.report.page import write_page
from apf.tracking.people import PeopleTracks
from apf.tracking.progress import StageProgress
from apf.tracking.settings import GivenStart
from apf.tracking.track import Track
from cl import InputError
from psfs.cli.commandline import stderr, warn
from psfs.common.numbers import select_span
from psfs.people.people import count_people, follow_several
from psfs.people.separation import separate
from psfs.sequence import Sequence
from psfs.session import Session

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Persons:
    """Several people, or one beside an object that moves: the frames (F,) that show each, the
    session of each, and the keypoints of each if there are some. frames: that were searched.
    objects: number of other things that move."""

    frames: range
    seen: list[np.ndarray]
    sessions: list[Session]
    keypoints: list[Keypoints] | None = None
    objects: int = 0

    def job(self, job: TrackJob, number: int) -> TrackJob:
        """Return the job of a person, counted from 1; the only one has all files of the take."""
        seen = self.seen[number - 1]
        if len(self.sessions) == 1:
            return replace(job, seen=seen)
        own = self.keypoints[number - 1] if self.keypoints is not None else None
        return job.person(number, len(self.sessions), seen, own)

    def without(self, number: int) -> Persons:
        """Return the others, where a person, counted from 1, is an object."""

        def rest(items: list[T]) -> list[T]:
            return [item for k, item in enumerate(items, start=1) if k != number]

        keypoints = None if self.keypoints is None else rest(self.keypoints)
        return Persons(
            self.frames, rest(self.seen), rest(self.sessions), keypoints, self.objects + 1
        )

    def gather(self, tracks: list[Track], verdicts: list[str]) -> PeopleTracks:
        """Return the tracks of the first people, or of all, with the frames that show them, as far
        as they were tracked."""
        seen = tuple(
            own[np.isin(own, track.frames)] for own, track in zip(self.seen, tracks, strict=False)
        )
        return PeopleTracks(
            tuple(tracks), np.array(self.frames), seen, self.objects, tuple(verdicts)
        )


def read_people_flag(args: argparse.Namespace, method: Method) -> int | None:
    """Return how many people --people asks for, None for as many as are seen. Raises InputError if
    there are several and another flag applies only to one."""
    if args.people == "auto":
        return None
    number = people_number(args.people)
    why = _explain_one_person(args, method)
    if number > 1 and why is not None:
        raise InputError(f"--people {number}: {why}; expected one person")
    return number


def _explain_one_person(args: argparse.Namespace, method: Method) -> str | None:
    """Return why only one person can be tracked, None if several can."""
    if not method.uses_voxels and method.objective != "keypoints":
        return f"--objective {method.objective} tracks one person"
    own_body = args.body is not None and Path(args.body).suffix == ".toml"
    flags = {"--init": args.init, "--height": args.height}
    stated = [flag for flag, value in flags.items() if value is not None]
    stated += ["--body FILE"] if own_body else []
    return f"{stated[0]} applies only to one person" if stated else None


def find_persons(
    job: TrackJob, session: Session, given: GivenStart | None, line: StageProgress
) -> Persons | None:
    """Return the people of a session, None if one person is to be tracked as if alone: nothing
    else moves, --people says so, or a flag applies only to one person."""
    args, sequence = job.args, session.sequence
    wanted = read_people_flag(args, job.method)
    why = _explain_one_person(args, job.method)
    if wanted == 1 or (wanted is None and sequence.subject == "object"):
        return None
    if wanted is None and (why is not None or given is not None):
        if why is not None:
            _warn_of_others(job, session, why)
        return None
    if not job.method.uses_voxels:
        return _find_by_keypoints(job, session, wanted)
    line("people")
    found = follow_several(session, wanted)
    if wanted is not None:
        _warn_of_another_number(session, wanted)
    if found is None:
        return None
    if wanted is None:
        stderr.print(f"{sequence.name}: {found.describe()}", soft_wrap=True, markup=False)
    keypoints = read_people_keypoints(args, session, found)
    sessions = separate(session, found, lambda: line("people"))
    seen = [person.frames for person in found]
    return Persons(found.frames, seen, sessions, keypoints, found.objects)


def _warn_of_another_number(session: Session, wanted: int) -> None:
    """Warn if more or fewer people are seen than --people says."""
    counted = count_people(session)
    if len(counted) != wanted:
        name, seen = session.sequence.name, counted.describe()
        warn(f"{name}: --people is {wanted}; without it {seen}: look at the overlay")


def _warn_of_others(job: TrackJob, session: Session, why: str) -> None:
    """Warn that only one person is tracked, if several are seen; why: see `_explain_one_person`."""
    seen = ""
    if job.method.objective != "keypoints":
        if len(session.rig) > 1 and len(people := count_people(session)) > 1:
            seen = people.describe()
    elif job.args.keypoints is not None:
        number = len(open_people_keypoints(job.args, session.sequence, None))
        seen = _describe_keypoints(number) if number else ""
    if seen:
        warn(f"{session.sequence.name}: {seen}; one is tracked, as {why}")


def _describe_keypoints(number: int) -> str:
    return f"{number} people are seen in the keypoints"


def _find_by_keypoints(job: TrackJob, session: Session, number: int | None) -> Persons | None:
    """Return the people of a session by the keypoints alone, None if there is only one. number: how
    many, None for as many as are seen."""
    if job.args.keypoints is None:
        return None  # what needs them says so
    frames = np.array(session.frames)
    everybody = open_people_keypoints(job.args, session.sequence, number)
    seen = [find_seen_frames(keypoints, frames) for keypoints in everybody]
    persons = [(own, keypoints) for own, keypoints in zip(seen, everybody, strict=True) if len(own)]
    if len(persons) < 2:
        return None
    selections = [select_span(own, session.frames.step) for own, _ in persons]
    sessions = [
        Session(session.sequence, session.device, replace(session.settings, selection=selection))
        for selection in selections
    ]
    shown = [own for own, _ in persons]
    if number is None:
        counted = _describe_keypoints(len(persons))
        stderr.print(f"{session.sequence.name}: {counted}", soft_wrap=True, markup=False)
    return Persons(session.frames, shown, sessions, [keypoints for _, keypoints in persons])


def write_together(
    job: TrackJob, tracks: PeopleTracks, sequence: Sequence, line: StageProgress | None
) -> None:
    """Write people.json; and, as the flags say, the overlay and the page of all people, unless
    `line`, which receives the progress, is None for a track that was interrupted. With several
    seeds nothing: each person's folders hold a track per seed."""
    folder: Path = job.args.output
    if len(job.seeds) > 1:
        return
    tracks.save_list(folder)
    if line is None:
        return
    if not job.args.no_overlay:
        line.n_frames = len(tracks.frames)
        line.begin("overlay")
        write_overlay(folder / OVERLAY, sequence, tracks, lambda: line("overlay"))
    if not job.args.no_report:
        write_page(folder / PAGE, sequence.name, tracks, folder / OVERLAY)

"""The people of a take: whether there are several, and a session for each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from apf.keypoints.keypoints import Keypoints
from apf.request import TrackingRequest
from apf.takes.job import TrackJob
from apf.takes.keypoints import (
    find_seen_frames,
    match_people_keypoints,
    open_people_keypoints,
    people_number,
)
from apf.tracking.people import PeopleTracks
from apf.tracking.settings import GivenStart
from apf.tracking.track import Track
from cl import InputError
from psfs.common.numbers import select_span
from psfs.people.people import count_people, follow_several
from psfs.people.separation import separate
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
        keypoints = self.keypoints[number - 1] if self.keypoints is not None else None
        return job.person(number, len(self.sessions), seen, keypoints)

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
            frames[np.isin(frames, track.frames)]
            for frames, track in zip(self.seen, tracks, strict=False)
        )
        return PeopleTracks(
            tuple(tracks), np.array(self.frames), seen, self.objects, tuple(verdicts)
        )


def check_people(request: TrackingRequest) -> int | None:
    """Return how many people are asked for, None for as many as are seen. Raises InputError if
    there are several and something else that is stated applies only to one."""
    if request.people == "auto":
        return None
    number = people_number(request.people)
    why = _explain_one_person(request)
    if number > 1 and why:
        raise InputError(f"--people {number}: {why}; expected one person")
    return number


def _explain_one_person(request: TrackingRequest) -> str:
    """Return why only one person can be tracked, an empty text if several can."""
    method = request.method
    if not method.uses_voxels and method.objective != "keypoints":
        return f"--objective {method.objective} tracks one person"
    body = request.body
    own_body = isinstance(body, (str, Path)) and Path(body).suffix == ".toml"
    flags = {"--init": request.init, "--height": request.height}
    stated = [flag for flag, value in flags.items() if value is not None]
    stated += ["--body FILE"] if own_body else []
    return f"{stated[0]} applies only to one person" if stated else ""


def find_persons(job: TrackJob, session: Session, given: GivenStart | None) -> Persons | None:
    """Return the people of a session, None if one person is to be tracked as if alone: nothing
    else moves, the request says so, or something in it applies only to one person."""
    request, progress, sequence = job.request, job.progress, session.sequence
    wanted = check_people(request)
    if wanted == 1 or (wanted is None and sequence.subject == "object"):
        return None
    why = job.why_one or _explain_one_person(request)
    if wanted is None and (why or given is not None):
        if why and not (job.why_one and given is not None):
            _warn_of_others(job, session, why)
        return None
    if not request.method.uses_voxels:
        return _find_by_keypoints(job, session, wanted)
    progress("people")
    people = follow_several(session, wanted)
    if wanted is not None:
        _warn_of_another_number(session, wanted, progress.warn)
    if people is None:
        return None
    if wanted is None:
        progress.tell(f"{sequence.name}: {people.describe()}")
    keypoints = match_people_keypoints(request.keypoints, session, people, progress)
    seen = [person.frames for person in people]
    return Persons(people.frames, seen, [*separate(session, people)], keypoints, people.objects)


def _warn_of_another_number(session: Session, wanted: int, warn: Callable[[str], object]) -> None:
    """Warn if more or fewer people are seen than are asked for."""
    counted = count_people(session)
    if len(counted) != wanted:
        name, seen = session.sequence.name, counted.describe()
        warn(f"{name}: --people is {wanted}; without it {seen}: look at the overlay")


def _warn_of_others(job: TrackJob, session: Session, why: str) -> None:
    """Warn that only one person is tracked, and why, if several are seen."""
    seen, given = "", job.request.keypoints
    if job.request.method.objective != "keypoints":
        if len(session.rig) > 1 and len(people := count_people(session)) > 1:
            seen = people.describe()
    elif given is not None:
        number = len(open_people_keypoints(given, session.sequence, None, job.progress.warn))
        seen = _describe_keypoints(number) if number > 1 else ""
    if seen:
        job.progress.warn(f"{session.sequence.name}: {seen}; one is tracked, as {why}")


def _describe_keypoints(number: int) -> str:
    return f"{number} people are seen in the keypoints"


def _find_by_keypoints(job: TrackJob, session: Session, number: int | None) -> Persons | None:
    """Return the people of a session by the keypoints alone, None if there is only one. number: how
    many, None for as many as are seen."""
    given = job.request.keypoints
    if given is None:
        return None  # what needs them says so
    frames = np.array(session.frames)
    everybody = open_people_keypoints(given, session.sequence, number, job.progress.warn)
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
        job.progress.tell(f"{session.sequence.name}: {_describe_keypoints(len(persons))}")
    return Persons(session.frames, shown, sessions, [keypoints for _, keypoints in persons])

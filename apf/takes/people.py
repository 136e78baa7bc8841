"""The people of a take: whether there are several, and a session for each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from apf.keypoints.keypoints import Keypoints
from apf.request import TrackingRequest
from apf.takes.job import TrackJob
from apf.takes.keypoints import (
    find_seen_frames,
    match_people_keypoints,
    open_people_keypoints,
    people_number,
    read_keypoints,
)
from apf.tracking.people import PeopleTracks, person_folder
from apf.tracking.settings import GivenStart
from apf.tracking.track import Track
from cl import InputError
from psfs.common.numbers import select_span
from psfs.diagnostics.examination import Examination
from psfs.people.people import count_people, follow_several
from psfs.people.separation import separate
from psfs.session import Session


@dataclass(frozen=True, eq=False)
class Person:
    """A person of a take: the frames (F,) that show them, None for all, their session, and their
    keypoints if there are some, with what looks wrong about these."""

    seen: np.ndarray | None
    session: Session
    keypoints: Keypoints | None = None
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Persons:
    """The people of a take. frames: that were searched. objects: number of other things that
    move."""

    frames: range
    everybody: tuple[Person, ...]
    objects: int = 0

    @property
    def alone(self) -> bool:
        """Whether there is one person in all frames, and nothing else that moves."""
        return self.everybody[0].seen is None

    def job(self, job: TrackJob, number: int) -> TrackJob:
        """Return the job of a person, counted from 1; the only one has all files of the take, each
        of several a folder."""
        person, people, out = self.everybody[number - 1], len(self.everybody), job.request.output
        job = replace(job, seen=person.seen, keypoints=person.keypoints, doubts=person.doubts)
        if people == 1:
            return job
        request = job.request.replace(output=out and person_folder(out, number))
        return replace(job, request=request, of_people={"person": number, "people": people})

    def without(self, number: int) -> Persons:
        """Return the others, where a person, counted from 1, is an object."""
        others = self.everybody[: number - 1] + self.everybody[number:]
        return replace(self, everybody=others, objects=self.objects + 1)

    def gather(self, tracks: list[Track], verdicts: list[str]) -> PeopleTracks:
        """Return the tracks of the first people, or of all, with the frames that show them, as far
        as they were tracked."""
        frames = np.array(self.frames)
        shown = (frames if person.seen is None else person.seen for person in self.everybody)
        seen = tuple(
            of[np.isin(of, track.frames)] for of, track in zip(shown, tracks, strict=False)
        )
        return PeopleTracks(tuple(tracks), frames, seen, self.objects, tuple(verdicts))


def check_people(request: TrackingRequest) -> int | None:
    """Return how many people are asked for, None for as many as are seen. Raises InputError if
    there are several and something else that is stated applies only to one."""
    number, why = people_number(request.people), _explain_one_person(request)
    if number is not None and number > 1 and why:
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


def find_persons(job: TrackJob, examination: Examination, given: GivenStart | None) -> Persons:
    """Return the people of an examined take: one, if nothing else moves, the request says so, or
    something in it applies only to one person."""
    session = examination.session
    found = _find_several(job, session, given)
    if found is None:
        stated, progress = job.request.keypoints, job.progress
        opened = read_keypoints(stated, session.sequence, progress, examination.diagnosis)
        found = Persons(session.frames, (Person(None, session, *opened),))
    return found


def _find_several(job: TrackJob, session: Session, given: GivenStart | None) -> Persons | None:
    """Return the people of a session, None if one is to be tracked as if alone."""
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
        if len(counted := count_people(session)) != wanted:
            progress.warn(
                f"{sequence.name}: --people is {wanted}; without it {counted.describe()}: look at "
                "the overlay"
            )
    elif (counted := count_people(session)).misses_somebody:
        progress.warn(f"{sequence.name}: {counted.describe()}")
    if people is None:
        return None
    if wanted is None:
        progress.tell(f"{sequence.name}: {people.describe()}")
    keypoints = match_people_keypoints(request.keypoints, session, people, progress)
    each = zip(people, separate(session, people), keypoints, strict=True)
    everybody = tuple(Person(person.frames, apart, points) for person, apart, points in each)
    return Persons(people.frames, everybody, people.objects)


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
    everybody: list[Person] = []
    for keypoints in open_people_keypoints(given, session.sequence, number, job.progress.warn):
        seen = find_seen_frames(keypoints, frames)
        if len(seen):
            settings = replace(session.settings, selection=select_span(seen, session.frames.step))
            own = Session(session.sequence, session.device, settings)
            everybody.append(Person(seen, own, keypoints))
    if len(everybody) < 2:
        return None
    if number is None:
        job.progress.tell(f"{session.sequence.name}: {_describe_keypoints(len(everybody))}")
    return Persons(session.frames, tuple(everybody))

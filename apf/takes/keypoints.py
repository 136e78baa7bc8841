"""The keypoints of a take, of one person or several."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Sequence as Items
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from apf.keypoints.agreement import find_disagreements
from apf.keypoints.association import match_to_people
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.opening import expand_wildcards
from apf.keypoints.timing import describe_lag, find_lag_to_footage
from apf.tracking.people import MOST_PEOPLE
from apf.tracking.progress import StageProgress
from cl import InputError
from psfs.diagnostics.examination import Diagnosis
from psfs.people.people import People
from psfs.sequence import Sequence
from psfs.session import Session

#: Keypoints of one person or several as they are given: their path, or themselves.
Given = Any


def people_number(stated: int | str) -> int | None:
    """Return the number of people that is stated, None for auto. Raises InputError."""
    if stated == "auto":
        return None
    if not isinstance(stated, int) or not 1 <= stated <= MOST_PEOPLE:
        raise InputError(f"--people is {stated}; expected 1 to {MOST_PEOPLE}, or auto")
    return stated


def read_keypoints(
    given: Given, sequence: Sequence, progress: StageProgress, diagnosis: Diagnosis | None = None
) -> tuple[Keypoints | None, tuple[str, ...]]:
    """Read the given keypoints for the cameras and frames of `sequence`; return them, and what
    looks wrong about them.

    Tell what was guessed about them, and what looks wrong between them, or against the silhouettes
    of the footage's `diagnosis`. Raises InputError.
    """
    if given is None or isinstance(given, Keypoints):
        return given, ()
    path = keypoints_path(given, sequence.folder)
    if sequence.settings.cameras is None:
        keypoints = Keypoints.open(path, sequence)
    else:  # of some cameras only: the assignment may need all of them
        every = sequence.with_all_cameras()
        keypoints = Keypoints.open(path, every).select_cameras(sequence.rig.names)
    for note in keypoints.notes:
        progress.note(note)
    wrong = find_disagreements(keypoints, sequence.rig, sequence.fps)
    if diagnosis is not None and not wrong and sequence.settings.sync is None:
        lag = find_lag_to_footage(keypoints, sequence.rig, diagnosis.views)
        if lag:
            wrong = [
                f"all keypoints come about {describe_lag(lag, sequence.fps)} against the pictures; "
                "expected those of the same frames"
            ]
    for text in wrong:
        progress.warn(f"{path}: {text}")
    return keypoints, tuple(wrong)


def keypoints_path(given: str | Path, folder: Path) -> Path:
    """Return the path of keypoints: as given if it exists, else relative to the sequence's
    folder."""
    path = Path(given)
    if path.is_absolute() or expand_wildcards(path)[1]:
        return path
    return folder / path


def open_people_keypoints(
    given: Given, sequence: Sequence, number: int | None, warn: Callable[[str], object]
) -> list[Keypoints]:
    """Return the given keypoints of each of at most `number` people, None for as many as are seen,
    who are assigned between cameras by the keypoints alone; none of a single person, or of chosen
    cameras, unless `number` is stated. Raises InputError."""
    if not isinstance(given, (str, Path)):
        return [given] if isinstance(given, Keypoints) else list(given)
    path = keypoints_path(given, sequence.folder)
    chosen = sequence.settings.cameras is not None
    if number is None:
        people: list[Keypoints] = []
        if not chosen:
            with suppress(InputError):  # who reads one person's says what is wrong
                people = Keypoints.open_people(path, sequence, "auto")
        return people if len(people) > 1 else []
    if chosen:
        raise InputError(
            "--people with --cameras: persons are assigned in all cameras; expected one of them"
        )
    people = Keypoints.open_people(path, sequence, number)
    if len(people) < number:
        warn(f"{sequence.name}: --people is {number}; {len(people)} seen by several cameras")
    return people


def find_seen_frames(keypoints: Keypoints, frames: np.ndarray) -> np.ndarray:
    """Return those of `frames` (F,) in which at least two cameras have keypoints."""
    shown = np.isfinite(keypoints.points[:, frames]).all(-1).any(-1).sum(0) > 1
    return np.asarray(frames[shown])


def match_people_keypoints(
    given: Given, session: Session, people: People, progress: StageProgress
) -> Items[Keypoints | None]:
    """Return the given keypoints of each person; None for each if none are given. Raises InputError
    if somebody has none."""
    if given is None:
        return [None] * len(people)
    where = ""
    if isinstance(given, (str, Path)):
        path = keypoints_path(given, session.sequence.folder)
        given, where = Keypoints.open_people(path, session.sequence), f"{path}: "
    everybody = [given] if isinstance(given, Keypoints) else list(given)
    points = np.stack([one.points for one in everybody])
    matched = [
        replace(everybody[0], points=one) for one in match_to_people(points, people, session.rig)
    ]
    for note in matched[0].notes:
        progress.note(note)
    counts = [int(np.isfinite(one.points).any((0, 2, 3)).sum()) for one in matched]
    if min(counts) == 0:
        number = counts.index(0) + 1
        raise InputError(
            f"{where}no keypoints lie on person {number} of {len(people)} that the voxels show; "
            "expected some of each person, or --people 1"
        )
    return matched

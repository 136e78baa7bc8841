"""Flags of the commands that take keypoints of a pose network."""

from __future__ import annotations

import argparse
from contextlib import suppress
from pathlib import Path

import numpy as np

from apf.keypoints import Keypoints
from apf.keypoints.agreement import find_disagreements
from apf.keypoints.matching import match_to_people
from apf.keypoints.opening import expand_wildcards
from apf.keypoints.timing import describe_lag, find_lag_to_footage
from cl import InputError
from psfs.cli.commandline import remark, warn
from psfs.cli.sequence_flags import collect_overrides
from psfs.diagnostics.faults import Diagnosis
from psfs.people.people import People
from psfs.sequence import Sequence
from psfs.session import Session


def read_keypoints(
    args: argparse.Namespace, sequence: Sequence, diagnosis: Diagnosis | None = None
) -> Keypoints | None:
    """Read the keypoints of --keypoints for the cameras and frames of `sequence`; None without the
    flag.

    Print what was guessed about them, and what looks wrong between them, or against the silhouettes
    of the footage's `diagnosis`. Raises InputError.
    """
    if args.keypoints is None:
        return None
    path = keypoints_path(args, sequence.folder)
    if args.cameras is None:
        keypoints = Keypoints.open(path, sequence)
    else:  # of some cameras only: the assignment may need all of them
        flags = {
            name: value for name, value in collect_overrides(args).items() if name != "cameras"
        }
        every = Sequence.open(sequence.folder, **flags)
        keypoints = Keypoints.open(path, every).select_cameras(sequence.rig.names)
    for note in keypoints.notes:
        remark("note", "cyan", note)
    wrong = find_disagreements(keypoints, sequence.rig, sequence.fps)
    if diagnosis is not None and not wrong and sequence.settings.sync is None:
        lag = find_lag_to_footage(keypoints, sequence.rig, diagnosis.views)
        if lag:
            wrong = [
                f"all keypoints come about {describe_lag(lag, sequence.fps)} against the pictures; "
                "expected those of the same frames"
            ]
    for text in wrong:
        warn(f"{path}: {text}")
    args.remarks = [*getattr(args, "remarks", ()), *wrong]
    args.opened_keypoints, args.keypoint_doubts = keypoints, tuple(wrong)
    return keypoints


def keypoints_path(args: argparse.Namespace, folder: Path) -> Path:
    """Return the path of --keypoints: as given if it exists, else relative to the sequence's
    folder."""
    given = Path(args.keypoints)
    if given.is_absolute() or expand_wildcards(given)[1]:
        return given
    return folder / given


def open_people_keypoints(
    args: argparse.Namespace, sequence: Sequence, number: int | None
) -> list[Keypoints]:
    """Return the keypoints of --keypoints of each of at most `number` people, None for as many as
    are seen, who are assigned between cameras by the keypoints alone; none of a single person, or
    of cameras that --cameras chooses, unless `number` is stated. Raises InputError."""
    path = keypoints_path(args, sequence.folder)
    if number is None:
        people: list[Keypoints] = []
        if args.cameras is None:
            with suppress(InputError):  # who reads one person's says what is wrong
                people = Keypoints.open_people(path, sequence, "auto")
        return people if len(people) > 1 else []
    if args.cameras is not None:
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


def read_people_keypoints(
    args: argparse.Namespace, session: Session, people: People
) -> list[Keypoints] | None:
    """Return the keypoints of --keypoints of each person; None without the flag. Raises InputError
    if somebody has none."""
    if args.keypoints is None:
        return None
    sequence = session.sequence
    path = keypoints_path(args, sequence.folder)
    found = match_to_people(Keypoints.open_people(path, sequence), people, session.rig)
    for note in found[0].notes:
        remark("note", "cyan", note)
    shown = [int(np.isfinite(own.points).any((0, 2, 3)).sum()) for own in found]
    if min(shown) == 0:
        number = shown.index(0) + 1
        raise InputError(
            f"{path}: no keypoints lie on person {number} of {len(people)} that the voxels show; "
            "expected some of each person, or --people 1"
        )
    return found

"""`apf keypoints`: detect 2-D keypoints in all cameras with a pose network."""

from __future__ import annotations

import argparse
from contextlib import closing
from pathlib import Path

import numpy as np

from apf.cli.people_flag import people_number
from apf.keypoints.estimation import EstimationJob, estimate_keypoints, write_openpose
from apf.keypoints.network import check_network
from cl import InputError, select_device
from psfs.cli.commandline import progress_bar, stdout, warn
from psfs.cli.sequence_flags import collect_overrides, open_sequence
from psfs.cli.settings import FILE, write_settings
from psfs.common.outputs import output_folder
from psfs.people.people import follow_several
from psfs.people.standing import StandingPeople
from psfs.sequence import Sequence
from psfs.session import Session

#: Least share of a camera's frames with a detected person; below it a warning is logged.
_SELDOM = 0.8


def run(args: argparse.Namespace) -> None:
    if args.at_once is not None and args.at_once < 1:
        raise InputError(f"--at-once is {args.at_once}; expected at least 1")
    check_network()
    number = None if args.people == "auto" else people_number(args.people)
    sequence = open_sequence(args)
    pattern = "*_json/*_[0-9][0-9][0-9][0-9][0-9][0-9].json"
    with output_folder(args.output, args.parser.prog, sequence.inputs, (pattern, FILE)):
        found = _detect(args, sequence, number)
        write_settings(args.output, args)
    for camera, counts in found.items():
        for person, frames in enumerate(counts, start=1):
            if frames < _SELDOM * len(sequence):
                who = "a person" if len(counts) == 1 else f"person {person}"
                warn(f"{camera}: {who} was found in {frames} of {len(sequence)} frames only")
    stdout.print(
        f"{len(sequence)} frames x {len(sequence.rig)} cameras: {args.output}", soft_wrap=True
    )


def _detect(
    args: argparse.Namespace, sequence: Sequence, number: int | None
) -> dict[str, list[int]]:
    """Write the keypoints of each camera as soon as it is done; return the number of its frames in
    which each person was found. number: of people, None for as many as are seen."""
    people = _find_people(args, sequence, number)
    crop = sequence.empty_scene and not args.no_crop and people is None
    device = args.device if crop else None
    job = EstimationJob(Path(args.folder), collect_overrides(args), device, people)
    bar = progress_bar()
    task = bar.add_task("keypoints", total=len(sequence) * len(sequence.rig))

    def show(done: int) -> None:
        if done:  # not before: an error must stay a single line
            bar.start()
        bar.update(task, completed=done)

    found = {}
    try:
        with closing(estimate_keypoints(job, args.at_once, show)) as cameras:
            for camera, points in cameras:
                write_openpose(args.output / f"{camera}_json", camera, points)
                found[camera] = np.isfinite(points).any((2, 3)).sum(1).tolist()
    finally:
        if bar.live.is_started:
            bar.stop()
    return found


def _find_people(
    args: argparse.Namespace, sequence: Sequence, number: int | None
) -> StandingPeople | None:
    """Return where people stand; None for one person."""
    if number == 1:
        return None
    people = follow_several(Session(sequence, select_device(args.device)), number)
    if people is None or len(people) < 2:
        stdout.print(f"{sequence.name}: one person is seen")
        return None
    stdout.print(f"{sequence.name}: {people.describe()}")
    return people.find_places()

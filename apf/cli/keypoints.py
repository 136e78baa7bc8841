"""`apf keypoints`: detect 2-D keypoints in all cameras with a pose network."""

from __future__ import annotations

import os
from contextlib import ExitStack, closing
from functools import partial

import numpy as np

from apf.cluster.processes import Processes, Task
from apf.cluster.workers import Share
from apf.keypoints.estimation import estimate_camera, write_openpose
from apf.keypoints.network import check_network
from apf.request import KeypointsRequest
from apf.takes.keypoints import people_number
from cl import InputError, select_device
from psfs.cli.commandline import progress_bar, stdout, warn
from psfs.common.outputs import output_folder
from psfs.common.requests import SETTINGS, write_settings
from psfs.opening import open_sequence, stated_keys
from psfs.people.people import StandingPeople, follow_several
from psfs.sequence import Sequence
from psfs.session import Session

#: Least share of a camera's frames with a detected person; below it a warning is logged.
_SELDOM = 0.8


def run(request: KeypointsRequest) -> None:
    check_network()
    number = people_number(request.people)
    sequence = open_sequence(request)
    pattern = "*_json/*_[0-9][0-9][0-9][0-9][0-9][0-9].json"
    with output_folder(request.output, request.COMMAND, sequence.inputs, (pattern, SETTINGS)):
        found = _detect(request, sequence, number)
        write_settings(request.output, request)
    for camera, counts in found.items():
        for person, frames in enumerate(counts, start=1):
            if frames < _SELDOM * len(sequence):
                who = "a person" if len(counts) == 1 else f"person {person}"
                warn(f"{camera}: {who} was found in {frames} of {len(sequence)} frames only")
    stdout.print(f"{len(sequence)} frames x {len(sequence.rig)} cameras: {request.output}")


def _detect(
    request: KeypointsRequest, sequence: Sequence, number: int | None
) -> dict[str, list[int]]:
    """Write the keypoints of each camera as soon as it is done; return the number of its frames in
    which each person was found. number: of people, None for as many as are seen."""
    if not sequence.has_images:
        what = "has masks only; expected pictures to find keypoints in"
        raise InputError(f"{request.folder}: {what}")
    people = _find_people(request, sequence, number)
    crop = sequence.empty_scene and request.crop and people is None
    stated, names, n_frames = stated_keys(request.capture), sequence.rig.names, len(sequence)
    rest = n_frames, request.device if crop else None, people
    found, done = {}, dict.fromkeys(names, 0)
    with progress_bar() as bar, ExitStack() as stack:
        bar_task = bar.add_task("keypoints", total=n_frames * len(names))

        def show(camera: str, frames: int) -> None:
            done[camera] = frames
            bar.update(bar_task, completed=sum(done.values()))

        shares = [Share(request.device)] * min(len(names), request.at_once or os.cpu_count() or 1)
        pool = stack.enter_context(Processes(shares, lambda report: show(report.task, report.done)))
        arguments = {name: (request.folder, {**stated, "cameras": [name]}, *rest) for name in names}
        jobs = (
            (name, partial(pool.run, Task(name, estimate_camera, own)))
            for name, own in arguments.items()
        )
        for camera, points in stack.enter_context(closing(pool.outcomes(jobs))):
            if isinstance(points, BaseException):
                raise points
            show(camera, n_frames)
            write_openpose(request.output / f"{camera}_json", camera, points)
            found[camera] = np.isfinite(points).any((2, 3)).sum(1).tolist()
    return found


def _find_people(
    request: KeypointsRequest, sequence: Sequence, number: int | None
) -> StandingPeople | None:
    """Return where people stand; None for one person."""
    if number == 1:
        return None
    people = follow_several(Session(sequence, select_device(request.device)), number)
    if people is None or len(people) < 2:
        stdout.print(f"{sequence.name}: one person is seen")
        return None
    stdout.print(f"{sequence.name}: {people.describe()}")
    return people.find_positions()

"""Where the people of a live run begin: from the flags, or found in a recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from apf.body.kinematics import posed_joints
from apf.evaluation.truth import load_people_truth
from apf.filters.method import Method
from apf.live.cameras import box_around, open_cameras
from apf.live.session import LiveStart
from apf.live.sources import Replay, Source
from apf.request import LiveRequest
from apf.takes.keypoints import people_number
from apf.takes.start import (
    find_first_pose,
    fit_to_truth,
    load_template,
    read_given_start,
)
from apf.tracking.settings import GivenStart
from cl import Device, InputError
from psfs.cli.commandline import stderr, warn
from psfs.common.numbers import select_span
from psfs.opening import open_sequence, open_session, select_common_frames, stated_keys
from psfs.people.people import People, count_people
from psfs.people.separation import join_session, separate
from psfs.session import Session, SessionSettings
from psfs.volume import automatic_grid
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.occupied_box import default_voxel_size

#: Time, s, in whose frames people are separated for their starts, and the least number of these.
_START_SECONDS, _FEWEST_FRAMES = 1.0, 2
#: Time, s, in which people are counted where one is followed: the whole may be hours.
_COUNT_SECONDS = 2.0


def read_live_people(request: LiveRequest, method: Method) -> int | None:
    """Return how many people --people asks for, None for as many as are seen. Raises InputError if
    several cannot be tracked."""
    number = people_number(1 if request.people is None else request.people)
    if number != 1 and not method.uses_voxels:
        raise InputError(
            f"--people {request.people}: --objective {method.objective} tracks one person; "
            "expected 1"
        )
    return number


def start_replay(
    request: LiveRequest, method: Method, device: Device, number: int | None
) -> tuple[Source, LiveStart]:
    """Return a recorded sequence, its grid if voxels are needed, and the people's bodies and first
    poses."""
    sequence = open_sequence(request)
    frames = select_common_frames(request.frames, sequence, warn)
    session = open_session(request, sequence, device)
    if number != 1:
        everybody = _start_people(request, session, frames, number)
        if everybody is not None:
            room, given = everybody
            return Replay(sequence, frames), LiveStart(room, given)
    one = read_given_start(
        sequence.folder, frames[0], request.body, request.init, request.convention
    )
    grid = None
    if method.uses_voxels or one is None:
        grid = automatic_grid(session)
    if one is None:
        one = find_first_pose(session, request, None, warn)
    if request.people is None:
        warn_of_others(session, frames, one)
    return Replay(sequence, frames), LiveStart(grid, [one])


def start_captures(
    request: LiveRequest, method: Method, number: int | None
) -> tuple[Source, LiveStart]:
    """Return cameras, the grid of --volume or one around the first pose if voxels are needed, and
    the people's bodies and first poses."""
    folder = Path(request.folder)
    if number == 1:
        start = read_given_start(folder, 0, request.body, request.init, request.convention)
        given = [] if start is None else [start]
    else:
        given = _read_starts(request, 0, number)
        if len(given) > 1 and request.capture.volume is None:
            raise InputError(
                "the voxel grid follows one person; expected --volume that holds all people"
            )
    if not given:
        raise InputError("cameras have no first pose; expected --init with a pose file or joints")
    source = open_cameras(
        folder, stated_keys(request.capture), list(request.captures or ()), request.empty
    )
    grid = None
    if method.uses_voxels:
        body, pose, *_ = given[0]
        low, high = np.array(request.capture.volume or box_around(body, pose))
        size = request.voxel_size or default_voxel_size(source.rig, low, high)
        grid = VoxelGrid.covering(low, high, size)
    return source, LiveStart(grid, given)


def _start_people(
    request: LiveRequest,
    session: Session,
    frames: range,
    number: int | None,
) -> tuple[VoxelGrid, list[GivenStart]] | None:
    """Return a grid that holds all people of a recording, and the starts of those that its first
    frame shows; None if there is one person."""
    sequence = session.sequence
    people = count_people(session, number)
    if number is None:
        stderr.print(f"{sequence.name}: {people.describe()}")
    if len(people) < 2:
        if number is not None:
            warn(f"{sequence.name}: --people is {number}; {people.describe()}")
        return None
    grid = automatic_grid(join_session(session, people))
    if request.init is not None:
        return grid, _read_starts(request, frames[0], number)
    return grid, _find_starts(request, session, people, number)


def _find_starts(
    request: LiveRequest, session: Session, people: People, number: int | None
) -> list[GivenStart]:
    """Find everybody that the first of the frames show in which people were counted, each apart
    from the others."""
    frames = people.frames
    begun = select_beginning(session, frames, _START_SECONDS)
    first = begun.frames
    beginning = people.during(first)
    given: list[GivenStart] = []
    for person, own in zip(beginning, separate(begun, beginning), strict=True):
        if person.frames[0] == frames[0]:
            given.append(find_first_pose(own, request, None, warn, len(given) + 1))
    wanted = max(number or 0, len(people))
    if len(given) < wanted:
        warn(
            f"{session.sequence.name}: frame {frames[0]} shows {len(given)} of {wanted} people; "
            "only who is there when a live run begins is followed"
        )
    if not given:
        raise InputError(
            f"{session.sequence.name}: nobody is seen in frame {frames[0]}; expected --frames a: "
            "from a frame on that shows everybody"
        )
    return given


def select_beginning(session: Session, frames: range, seconds: float) -> Session:
    """Return a session of the first `seconds` of some frames."""
    first = frames[: max(_FEWEST_FRAMES, round(seconds * session.sequence.fps / frames.step))]
    selection = select_span(first, first.step)
    settings = SessionSettings(session.reconstruction, selection, session.settings.voxel_size)
    return Session(session.sequence, session.device, settings)


def warn_of_others(session: Session, frames: range, start: GivenStart) -> None:
    """Warn that one person is followed, and which, if the beginning of a recording shows more."""
    if len(session.rig) < 2:
        return
    people = count_people(select_beginning(session, frames, _COUNT_SECONDS))
    if len(people) > 1:
        x, y, _ = posed_joints(start[0], start[1][None])[0].mean(axis=0)
        warn(
            f"{session.sequence.name}: {people.describe()}; one is followed, who begins at "
            f"x {x:.1f}, y {y:.1f} m; --people auto follows all, --people 1 counts nobody"
        )


def _read_starts(request: LiveRequest, frame: int, number: int | None) -> list[GivenStart]:
    """Return the bodies and poses of several people from the joints of --init in a frame."""
    path = request.init
    if path is None or path.suffix.lower() != ".npz":
        raise InputError(
            f"--people {request.people}: --init is {path}; expected an npz with the joints of "
            "several people (frames, people, joints, 3)"
        )
    template, _ = load_template(request.body)
    given = []
    for name, series in list(load_people_truth(path).items())[:number]:
        if np.isfinite(series.joints[series.frames == frame]).all((1, 2)).any():
            given.append(fit_to_truth(template, series, frame))
        else:
            warn(f"{path}: {name} has no joints in frame {frame}, and is not followed")
    if not given:
        raise InputError(f"{path}: holds nobody's joints in frame {frame}; expected those of all")
    if number is not None and len(given) < number:
        warn(f"--people is {number}; {path} shows {len(given)} in frame {frame}")
    return given

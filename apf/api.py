"""The library's main entry point: estimate a skeleton per frame of a sequence."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Sequence as Items
from pathlib import Path
from typing import Any

import numpy as np

from apf.body.model import BodyModel
from apf.filters.method import Method
from apf.keypoints.keypoints import Keypoints
from apf.request import TrackRequest
from apf.takes.results import FinishedTake
from apf.takes.start import STATURES, load_template
from apf.takes.track import run_track
from apf.tracking.people import MOST_PEOPLE, PeopleTracks
from apf.tracking.progress import open_progress
from apf.tracking.track import Track
from cl import Device as Device
from cl import DeviceError as DeviceError
from cl import InputError as InputError
from cl import MissingFileError as MissingFileError
from cl import NumpyDevice as NumpyDevice
from cl import UserError as UserError
from cl import select_device as select_device
from psfs.api import check_sequence, resolve_device
from psfs.common.ranges import check_kind, check_number
from psfs.sequence import Sequence
from psfs.voxels.config import ReconstructionConfig


def track(
    sequence: Sequence,
    *,
    device: Device | NumpyDevice | str | None = None,
    body: BodyModel | str | Path | None = None,
    init: np.ndarray | str | Path | None = None,
    method: Method | None = None,
    frames: slice | None = None,
    height: float | None = None,
    voxel_size: float | None = None,
    all_cameras: bool = False,
    progress: Callable[[str], object] | bool = True,
    keypoints: Keypoints | str | Path | None = None,
    reconstruction: ReconstructionConfig | None = None,
) -> Track:
    """Find the person in the chosen frames of `sequence` and track them, as `apf track` does.

    Estimates position, heading, size and first pose, tracks frame by frame, and finds a lost person
    again (Song et al. 2.3).

    device: where to compute, or its name as of `cl.select_device`; by default the fastest one.
    body: a model, the name of a shipped one or a TOML file; by default the sequence's own, else
    song32. Its size is estimated from the first voxels, unless it comes from a file. init: the
    first pose, if it is known: (D,) rad and m, a text file of them, or joints (npz, TRC) to which
    body and pose are fitted. method: the search and its settings, see `Method.create`. frames: all
    by default. height: stature of the person, m, if it is known. voxel_size: edge of a voxel, m.
    all_cameras: keep cameras that disagree with the others, see `psfs.reconstruct`. progress: by
    default a line with the stages and the time left, on a terminal and in a notebook; false for
    none; or a function, called with the name of each stage, and with "tracking" after each frame.
    keypoints: of a pose network, or their path (see `Keypoints.open`). They are used together with
    the voxels, or alone with `Method.create(objective="keypoints")`, which needs no background.
    reconstruction: settings of silhouettes and voxels.

    Of several people one is tracked, with a warning in the log: `track_people` tracks all. A
    KeyboardInterrupt ends the track after the last complete frame. Doubts about the start are
    logged as warnings. Raises InputError if nobody is found or a file is invalid, DeviceError if
    the device cannot be used.
    """
    done = _run(
        sequence, device, progress, why_one="apf.track follows one person, apf.track_people all",
        body=body, init=init, method=method, frames=frames, height=height, voxel_size=voxel_size,
        all_cameras=all_cameras, keypoints=keypoints, reconstruction=reconstruction,
    )  # fmt: skip
    done[0].raise_error()
    return done[0].take.tracks[0]


def track_people(
    sequence: Sequence,
    number: int | None = None,
    *,
    device: Device | NumpyDevice | str | None = None,
    body: str | None = None,
    method: Method | None = None,
    frames: slice | None = None,
    voxel_size: float | None = None,
    all_cameras: bool = False,
    progress: Callable[[str], object] | bool = True,
    keypoints: Items[Keypoints] | str | Path | None = None,
    reconstruction: ReconstructionConfig | None = None,
) -> PeopleTracks:
    """Track everybody in the chosen frames of `sequence`, as `apf track` does: `for track in
    track_people(sequence)`.

    number: how many people there are, if that is known; by default as many as are seen. body: the
    name of a shipped model, fitted to each person. keypoints: of all people, or their path; they
    are given to the people in the voxels, or, with `Method.create(objective="keypoints")`, tell
    alone who is where. The rest as of `track`. Raises as `track` does, and InputError for an
    impossible number, an objective of one person or a body of one person.
    """
    if number is not None:
        check_number("number", number, 1, MOST_PEOPLE)
    if isinstance(method, Method) and not (method.uses_voxels or method.objective == "keypoints"):
        raise InputError(f"the objective {method.objective} tracks one person; expected voxel")
    if isinstance(body, (str, Path)) and load_template(body)[1]:
        raise InputError(f"{body}: a file holds one person's body; expected a shipped name")
    done = _run(
        sequence, device, progress, people="auto" if number is None else number, body=body,
        method=method, frames=frames, voxel_size=voxel_size, all_cameras=all_cameras,
        keypoints=keypoints, reconstruction=reconstruction,
    )  # fmt: skip
    for one in done:
        one.raise_error()
    assert done[0].everybody is not None
    return done[0].everybody


def _run(
    sequence: Sequence,
    device: Device | NumpyDevice | str | None,
    progress: Callable[[str], object] | bool,
    why_one: str = "",
    **stated: Any,
) -> list[FinishedTake]:
    """Run a request with the fields that are `stated`; None stands for a field's default. Raises
    UserError."""
    check_sequence(sequence, stated["frames"])
    _check_arguments(**stated)
    frames = stated["frames"] or slice(None)
    if not len(range(len(sequence))[frames]):
        raise InputError(f"{frames} chooses none of the {len(sequence)} frames of {sequence.name}")
    stated |= {"folders": (sequence.folder,), "frames": frames}
    request = TrackRequest(**{name: value for name, value in stated.items() if value is not None})
    with open_progress(progress) as line:
        return run_track(request, resolve_device(device), line, sequence=sequence, why_one=why_one)


def _check_arguments(
    method: object = None,
    body: object = None,
    init: object = None,
    keypoints: Any = None,
    reconstruction: object = None,
    height: float | None = None,
    **_: object,
) -> None:
    """Raise InputError for an impossible height, m, or an argument of the wrong type."""
    if height is not None:
        check_number("height, m,", height, *STATURES)
    check_kind("method", method, (Method,), ", such as apf.Method.create()")
    check_kind("body", body, (BodyModel, str, Path))
    check_kind("init", init, (np.ndarray, str, Path))
    if not isinstance(keypoints, (list, tuple)):
        check_kind("keypoints", keypoints, (Keypoints, str, Path))
    check_kind("reconstruction", reconstruction, (ReconstructionConfig,))

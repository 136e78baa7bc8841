"""The library's main entry point: estimate a skeleton per frame of a sequence."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np

from apf.body import BodyModel, load_body
from apf.body.bodytrack import is_bodytrack, read_body
from apf.evaluation.evaluate import load_truth
from apf.evaluation.joint_names import match_joints
from apf.filters.method import Method
from apf.formats.pose import check_pose, read_pose
from apf.initialisation import StartError
from apf.initialisation.from_joints import fit_to_joints
from apf.keypoints.agreement import find_disagreements
from apf.keypoints.keypoints import Keypoints
from apf.tracking.people import MOST_PEOPLE, PeopleTracks
from apf.tracking.settings import DEFAULT_BODY, TakeSettings
from apf.tracking.take import Take, track_take
from apf.tracking.track import Track
from cl import Device as Device
from cl import DeviceError as DeviceError
from cl import InputError as InputError
from cl import MissingFileError as MissingFileError
from cl import NumpyDevice as NumpyDevice
from cl import UserError as UserError
from cl import select_device as select_device
from psfs.api import check_sequence, exclude_inconsistent_cameras, resolve_device
from psfs.common.ranges import check_kind, check_number
from psfs.people.people import count_people, follow_several
from psfs.people.separation import separate
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings
from psfs.voxels.config import ReconstructionConfig

log = logging.getLogger(__name__)


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
    progress: Callable[[str], object] | None = None,
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
    all_cameras: keep cameras that disagree with the others, see `psfs.reconstruct`. progress:
    called with the name of each stage, and with "tracking" after each frame. keypoints: of a pose
    network, or their path (see `Keypoints.open`). They are used together with the voxels, or alone
    with `Method.create(objective="keypoints")`, which needs no background. reconstruction: settings
    of silhouettes and voxels.

    Of several people one is tracked, with a warning in the log: `track_people` tracks all. A
    KeyboardInterrupt ends the track after the last complete frame. Doubts about the start are
    logged as warnings. Raises InputError if nobody is found or a file is invalid, DeviceError if
    the device cannot be used.
    """
    check_sequence(sequence, frames)
    kinds = {"method": method, "body": body, "init": init, "keypoints": keypoints}
    _check_arguments(height, **kinds, reconstruction=reconstruction)
    settings = SessionSettings(
        reconstruction or ReconstructionConfig(), frames or slice(None), voxel_size
    )
    session = _select_cameras(
        Session(sequence, resolve_device(device), settings), method, all_cameras
    )
    sequence = session.sequence
    if init is None and (method or Method()).uses_voxels:
        _warn_of_others(session)
    template, keep_shape = load_template(body)
    take_settings = TakeSettings(
        method=method or Method(),
        template=template,
        keep_shape=keep_shape,
        height=height,
        given=read_given_start(sequence.folder, session.frames[0], body, init),
        keypoints=_open_keypoints(keypoints, sequence),
    )
    return _whole_track(track_take(session, take_settings, progress))


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
    progress: Callable[[str], object] | None = None,
    reconstruction: ReconstructionConfig | None = None,
) -> PeopleTracks:
    """Track everybody in the chosen frames of `sequence`, as `apf track` does: `for track in
    track_people(sequence)`.

    number: how many people there are, if that is known; by default as many as are seen. body: the
    name of a shipped model, fitted to each person. The rest as of `track`. Raises as `track` does,
    and InputError for an impossible number, an objective without voxels or a body of one person.
    """
    check_sequence(sequence, frames)
    _check_arguments(None, method=method, body=body, reconstruction=reconstruction)
    if number is not None:
        check_number("number", number, 1, MOST_PEOPLE)
    if method is not None and not method.uses_voxels:
        raise InputError(f"the objective {method.objective} tracks one person; expected voxel")
    settings = SessionSettings(
        reconstruction or ReconstructionConfig(), frames or slice(None), voxel_size
    )
    session = _select_cameras(
        Session(sequence, resolve_device(device), settings), method, all_cameras
    )
    template, keep_shape = load_template(body)
    if keep_shape:
        raise InputError(f"{body}: a file holds one person's body; expected a shipped name")
    take_settings = TakeSettings(method=method or Method(), template=template)

    def tracked(own: Session) -> Track:
        return _whole_track(track_take(own, take_settings, progress))

    people = follow_several(session, number)
    if people is None:
        indices = np.array(session.frames)
        return PeopleTracks((tracked(session),), indices, (indices,))
    tracks: list[Track] = []
    seen: list[np.ndarray] = []
    objects = people.objects
    for person, own in zip(people, separate(session, people), strict=True):
        try:
            tracks.append(tracked(own))
            seen.append(person.frames)
        except StartError:
            objects += 1
            if number is not None or objects == people.objects + len(people):
                raise
    return PeopleTracks(tuple(tracks), np.array(people.frames), tuple(seen), objects)


def _select_cameras(session: Session, method: Method | None, all_cameras: bool) -> Session:
    """Return the session without cameras that disagree, unless all are kept or only keypoints are
    used. Raises InputError if no frame is chosen."""
    if method is None or method.objective != "keypoints":
        session = exclude_inconsistent_cameras(session, all_cameras)
    if not session.frames:
        chosen, sequence = session.settings.selection, session.sequence
        raise InputError(f"{chosen} chooses none of the {len(sequence)} frames of {sequence.name}")
    return session


def _warn_of_others(session: Session) -> None:
    """Log a warning if several people are seen."""
    if session.sequence.subject == "person":
        people = count_people(session)
        if len(people) > 1:
            seen = people.describe()
            name = session.sequence.name
            log.warning("%s: %s; one is tracked, apf.track_people tracks all", name, seen)


def _whole_track(take: Take) -> Track:
    """Return the only track of a take, and log doubts about its start. Raises the error that ended
    it early."""
    for doubt in take.start.doubts if take.start is not None else ():
        log.warning("%s: %s", take.sequence.name, doubt)
    if take.error is not None:
        raise take.error
    return take.tracks[0]


def _check_arguments(height: float | None, **arguments: object) -> None:
    """Raise InputError for an impossible height, m, or an argument of `track` of the wrong type."""
    if height is not None:
        check_number("height, m,", height, 0.5, 2.5)
    kinds: dict[str, tuple[type, ...]] = {
        "method": (Method,),
        "body": (BodyModel, str, Path),
        "init": (np.ndarray, str, Path),
        "keypoints": (Keypoints, str, Path),
        "reconstruction": (ReconstructionConfig,),
    }
    for name, value in arguments.items():
        hint = ", such as apf.Method.create()" if name == "method" else ""
        check_kind(name, value, kinds[name], hint)


def _open_keypoints(
    keypoints: Keypoints | str | Path | None, sequence: Sequence
) -> Keypoints | None:
    if keypoints is None or isinstance(keypoints, Keypoints):
        return keypoints
    found = Keypoints.open(keypoints, sequence)
    for text in find_disagreements(found, sequence.rig, sequence.fps):
        log.warning("%s: %s", keypoints, text)
    return found


def load_template(body: BodyModel | str | Path | None) -> tuple[BodyModel, bool]:
    """Return the body to start with, and whether it comes from a file and so has the person's own
    shape."""
    if isinstance(body, BodyModel):
        return body, False
    return load_body(body or DEFAULT_BODY), body is not None and Path(body).suffix == ".toml"


def read_given_start(
    folder: Path,
    frame: int,
    body: BodyModel | str | Path | None = None,
    init: np.ndarray | str | Path | None = None,
    convention: str = "y-up",
) -> tuple[BodyModel, np.ndarray] | None:
    """Return the body and its pose (D,) in `frame`, the first to be tracked; None if none is given.

    Without `body`, the sequence's own is used if its `folder` has one, with its own first pose.
    body, init: as of `track`. convention: axes of a TRC. Raises InputError.
    """
    own = body is None and is_bodytrack(folder)
    model = read_body(folder) if own else load_template(body)[0]
    if init is None:
        return (model, model.rest_pose) if own else None
    if isinstance(init, np.ndarray):
        if init.shape != (model.n_dof,) or init.dtype.kind not in "iuf":
            raise InputError(
                f"init is {init.dtype} of shape {init.shape}; expected ({model.n_dof},) numbers"
            )
        check_pose(init, model, "init")
        return model, init
    path = Path(init)
    if path.suffix.lower() not in (".npz", ".trc"):
        return model, read_pose(path, model)
    truth = load_truth(path, convention)
    rows = np.flatnonzero(truth.frames == frame)
    if not rows.size:
        raise InputError(f"{path}: no joints for frame {frame}, the first to be tracked")
    joints = {
        name: truth.joints[rows[0], column]
        for name, column in match_joints(truth.joint_names).items()
    }
    try:
        model, pose, _ = fit_to_joints(model, joints)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return model, pose

"""Open the take that a request describes, examine its footage, and select its frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from cl import Device, InputError, NumpyDevice
from psfs.cameras.camera import CameraRig
from psfs.common.files import resolve_path
from psfs.common.numbers import mean_known, pick_evenly
from psfs.diagnostics.examination import Examination, examine
from psfs.footage.settings import SequenceSettings
from psfs.people.people import extend_to_people
from psfs.request import ReconstructRequest, TakeRequest
from psfs.sequence import Sequence
from psfs.session import FrameReconstructor, Session, SessionSettings
from psfs.silhouettes.hidden import UNKNOWN
from psfs.volume import Volume, automatic_grid, find_volume
from psfs.voxels.body_prior import TrackedBody
from psfs.voxels.grid import VoxelGrid, check_size

T = TypeVar("T", bound=TakeRequest)


class Opened(Protocol):
    """A request with a folder."""

    @property
    def folder(self) -> Path: ...
    @property
    def capture(self) -> SequenceSettings: ...


#: Frames in which the track is compared with the silhouettes; least share of the body's axes that
#: lies on silhouettes: below it, the track is of another take.
_SAMPLES, _LEAST_AGREEMENT = 5, 0.4
#: Least length of the shortest view as a share of the longest one's, if no frames are stated.
_MOST_OF_THEM = 0.9


def stated_keys(capture: SequenceSettings) -> dict[str, object]:
    """Return the keys of `sequence.toml` that are stated, as `Sequence.open` takes them, in plain
    values."""
    keys = {key: value for key, value in capture if value is not None}
    if "calibration" in keys:
        keys["calibration"] = str(resolve_path(keys["calibration"]))
    if not isinstance(keys.get("volume", {}), Mapping):
        keys["volume"] = [np.asarray(corner).tolist() for corner in keys["volume"]]
    return {key: list(of) if isinstance(of, tuple) else of for key, of in keys.items()}


def open_sequence(request: Opened) -> Sequence:
    """Return the sequence that a request describes."""
    return Sequence.open(request.folder, **stated_keys(request.capture))


def open_session(request: TakeRequest, sequence: Sequence, device: Device | NumpyDevice) -> Session:
    """Return the session of the frames, and with the settings, that a request states."""
    frames = request.frames or slice(None)
    reconstruction = request.reconstruction.reaching(request.REACH)
    settings = SessionSettings(reconstruction, frames, request.voxel_size)
    return Session(sequence, device, settings)


def examine_footage(
    request: T, session: Session, warn: Callable[[str], object], person: bool = False
) -> tuple[Examination, T, list[str]]:
    """Examine the footage, see `examine`, and warn of its faults.

    Return the examination, the request with what was found (the cameras that were kept, and the
    shifts of late ones), so that a run that is opened again is the same, and the warnings. Raises
    InputError if fewer than two cameras show anything, or if `person` is true and the unit gives a
    size that no person has.
    """
    opened = session.sequence
    found = examine(session, request.all_cameras)
    found.check_sight()
    sequence = found.session.sequence
    unit = [str(fault) for fault in found.faults if fault.kind == "unit"]
    if unit and person:
        raise InputError(f"{sequence.name}: {unit[0]}")
    changes: dict[str, object] = {}
    if found.left_out:
        changes["cameras"] = tuple(sequence.rig.names)
    if opened.settings.sync == "auto":
        changes["sync"] = sequence.settings.sync
    if changes:
        request = request.replace(capture=request.capture.replace(**changes))
    remarks = [*sequence.timing_notes, *found.warnings]
    for text in remarks:
        warn(f"{sequence.name}: {text}")
    return found, request, remarks


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """What reconstructs the frames of a request: the examined footage, the grid, and the
    reconstructor. request: with what was found, see `examine_footage`."""

    request: ReconstructRequest
    examination: Examination
    grid: VoxelGrid
    reconstructor: FrameReconstructor

    @property
    def session(self) -> Session:
        """The session of the examined footage."""
        return self.examination.session


def prepare_reconstruction(
    request: ReconstructRequest,
    sequence: Sequence,
    device: Device | NumpyDevice,
    warn: Callable[[str], object],
    body: TrackedBody | None = None,
    volume: Volume | None = None,
) -> Reconstruction:
    """Examine the footage, find the volume, unless it is stated, and make what reconstructs its
    frames. body: a tracked body as a prior. Raises InputError."""
    session = open_session(request, sequence, device)
    examination, request, _ = examine_footage(request, session, warn)
    session = examination.session
    select_common_frames(request.frames, session.sequence, warn)
    if volume is not None:
        session.replace_result(find_volume, volume)
    else:
        extend_to_people(session, body)
    grid = automatic_grid(session)
    if request.grid is not None:
        box = find_volume(session)
        voxel_size = float(np.max((box.high - box.low) / request.grid))
        origin = (box.low + box.high - voxel_size * np.array(request.grid)) / 2
        grid = VoxelGrid(origin, voxel_size, request.grid)
    check_size(grid)
    if body is not None:
        check_body(session, body)
    return Reconstruction(request, examination, grid, session.reconstructor(grid, body))


def select_frames(frames: slice | None, sequence: Sequence) -> range:
    """Return the numbers of the stated frames, or of all. Raises InputError if there is none."""
    chosen = range(len(sequence))[frames or slice(None)]
    if not chosen:
        raise InputError(
            f"--frames chooses none of the {len(sequence)} frames of {sequence.folder}"
        )
    return chosen


def select_common_frames(
    frames: slice | None, sequence: Sequence, warn: Callable[[str], object]
) -> range:
    """Return the numbers of the stated frames, or of all; warn of views of different lengths.
    Raises InputError if no frame is selected, or many frames would be left out."""
    chosen = select_frames(frames, sequence)
    media = (*(sequence.footage.images or ()), *(sequence.footage.masks or ()))
    counts = {item.name: item.count for item in media}
    if frames is not None or len(set(counts.values())) == 1:
        return chosen
    found = ", ".join(f"{name} {count}" for name, count in counts.items())
    if len(sequence) < _MOST_OF_THEM * max(counts.values()):
        raise InputError(
            f"{sequence.folder}: unequal numbers of frames: {found}; expected as many of each "
            f"camera, or --frames 0:{len(sequence)} for those that all have"
        )
    warn(f"{sequence.name}: unequal numbers of frames: {found}; {len(sequence)} are used")
    return chosen


def check_body(session: Session, body: TrackedBody) -> None:
    """Raise InputError if the body lacks one of the session's frames, or if it does not lie on the
    silhouettes, see `_LEAST_AGREEMENT`."""
    body.check_frames(session.frames)
    known = [i for i in session.frames if np.isfinite(body[i]).all(-1).any()]
    if not known:
        raise InputError(
            f"{body.path}: the person is lost in all frames; expected some with a body"
        )
    indices = [known[i] for i in pick_evenly(len(known), _SAMPLES)]
    shares = [
        share_on_silhouettes(session.rig, evidence, body[index])
        for index, evidence in zip(indices, session.evidence(indices), strict=True)
    ]
    share = mean_known(shares, nothing=0.0)
    if share < _LEAST_AGREEMENT:
        raise InputError(
            f"{body.path}: {share:.0%} of the body's axes lie on the silhouettes of "
            f"{session.sequence.name}; expected {_LEAST_AGREEMENT:.0%} or more, as a track "
            "of that take has"
        )


def share_on_silhouettes(rig: CameraRig, evidence: np.ndarray, cones: np.ndarray) -> float:
    """Return the share of points on the axes of cones (C, 16) that lie on foreground, over all
    cameras that see them; NaN if none does. evidence: (V, H, W) int8."""
    known = cones[np.isfinite(cones).all(-1)]
    ends = known[:, 0:3], known[:, 4:7]
    points = np.concatenate([*ends, (ends[0] + ends[1]) / 2])
    seen = []
    for camera, counts in zip(rig, evidence, strict=True):
        _, row, column, _ = camera.look_up(points)
        seen.append(counts[row, column])
    counts = np.concatenate(seen)
    counts = counts[counts != UNKNOWN]
    return float((counts > 0).mean()) if counts.size else float("nan")

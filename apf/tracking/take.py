"""A take: from a session to its tracks, by the stages `initialise` and `track`."""

from __future__ import annotations

import time
from collections.abc import Callable
from collections.abc import Sequence as Items
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from apf.body import BodyModel
from apf.initialisation import Start, initialise
from apf.initialisation.from_keypoints import KeypointStart
from apf.initialisation.start import check_startable
from apf.tracking.keypoint_start import fit_to_keypoints
from apf.tracking.pipeline import TrackingTask, track_frames
from apf.tracking.settings import TakeSettings
from apf.tracking.track import Track
from cl import InputError, UserError
from psfs.sequence import Sequence
from psfs.session import Session
from psfs.volume import automatic_grid

#: Stores the body, its first pose (D,) and a part of each seed's track; returns where these are, or
#: None.
Keep: TypeAlias = Callable[[BodyModel, np.ndarray, Items[Track]], "Items[Path] | None"]


@dataclass(frozen=True, eq=False)
class Take:
    """A sequence that was tracked: `body`, from `pose` (D,) in the first frame on, one track for
    each seed. start: what was found in the first voxels; None where body and pose were given.
    seconds: of reconstruction and tracking, without the start. error: what ended the tracks
    early."""

    sequence: Sequence
    body: BodyModel
    pose: np.ndarray
    start: Start | None
    tracks: list[Track]
    seconds: float
    error: UserError | None = None


def track_take(
    session: Session,
    settings: TakeSettings | None = None,
    progress: Callable[[str], object] | None = None,
    keep: Keep | None = None,
) -> Take:
    """Find the person in the session's frames and track them.

    progress: called with the name of every stage that begins ("keypoints", "volume", "start",
    "preparing"), with "start" now and then during it, and with "tracking" after each frame, on the
    way back with "tracking back"; a KeyboardInterrupt during tracking ends the tracks after the
    last whole frame. keep: called about every second of tracking with the body, its first pose, and
    the tracks of the frames since it was called last, which are not held in memory if it stores
    them. Raises UserError; one after the first frame ends the tracks, and is the take's `error`.
    """
    settings = settings or TakeSettings()
    report = progress or (lambda stage: None)
    method, given = settings.tracked_method, settings.given
    start: Start | None = None
    witness: KeypointStart | None = None
    if given is None:
        check_startable(settings.body_template)  # before anything that takes time
    if settings.keypoints is not None:
        report("keypoints")
        witness, given = fit_to_keypoints(session, settings)
    if method.uses_voxels or given is None:
        check_cameras(session.sequence)
        report("volume")
        automatic_grid(session)
    if given is None:
        report("start")
        start = initialise(
            session, settings.body_template,
            height=settings.height, keep_shape=settings.keep_shape,
            seed=method.filter.search.seed, progress=lambda: report("start"),
        )  # fmt: skip
        given = start.body, start.pose
    body, pose = given
    report("preparing")
    began = time.perf_counter()
    points = None if witness is None else witness.observations
    task = TrackingTask(body, pose, method, settings.run_seeds, points)
    store = None if keep is None else lambda parts: keep(body, pose, parts)
    tracked = track_frames(session, task, report, store)
    seconds = time.perf_counter() - began
    return Take(session.sequence, body, pose, start, tracked.tracks, seconds, tracked.error)


def check_cameras(sequence: Sequence) -> None:
    """Raise InputError where voxels would be of one camera alone, which knows no depth."""
    if len(sequence.rig) < 2:
        raise InputError(
            f"{sequence.name}: one camera, {sequence.rig.names[0]}; expected two or more, which "
            "see the person from different sides at the same time"
        )

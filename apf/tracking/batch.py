"""Takes: a sequence from its pictures to its tracks, and many of them in one process.

`track_takes` works on some takes at a time, each in a thread with a queue of its own on the one
device. They share the process, the device's context and memory, and the programs, each of which is
compiled once for all takes of the same size; while one take's host decodes video or fits its
person's shape, the device works for another. They share no kernel launch: bodies, grids and numbers
of frames differ from take to take. (The seeds of one take do share them, see `track_seeds`.) So a
take's tracks are, bit by bit, those that it has alone.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Generator, Iterator
from collections.abc import Sequence as Items
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from apf.body import BodyModel, load_body
from apf.filters.method import Method
from apf.initialisation import Start, start_of
from apf.initialisation.from_keypoints import KeypointStart
from apf.initialisation.start import check_startable
from apf.keypoints.keypoints import Keypoints
from apf.tracking.config import BatchConfig
from apf.tracking.keypoint_start import learnt, method_with
from apf.tracking.pipeline import track_seeds
from apf.tracking.track import Track
from cl import Device, InputError, NumpyDevice, UserError
from psfs.reconstructor import ReconstructionConfig
from psfs.sequence import Sequence
from psfs.volume import automatic_grid
from psfs.voxels.grid import VoxelGrid

log = logging.getLogger(__name__)

R = TypeVar("R")
#: Keeps the body, its first pose (D,) and a part of each seed's track; returns where these are, or
#: None.
Keep = Callable[[BodyModel, np.ndarray, Items[Track]], "Items[Path] | None"]


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
    device: Device | NumpyDevice,
    sequence: Sequence,
    method: Method | None = None,
    seeds: Items[int] | None = None,
    *,
    given: tuple[BodyModel, np.ndarray] | None = None,
    template: BodyModel | None = None,
    keep_shape: bool = False,
    height: float | None = None,
    voxel_size: float | None = None,
    selection: slice | None = None,
    reconstruction: ReconstructionConfig | None = None,
    progress: Callable[[str], object] | None = None,
    keypoints: Keypoints | None = None,
    keep: Keep | None = None,
) -> Take:
    """Find the person in the selected frames of `sequence` and track them.

    given: a body and its first pose (D,), which then are not searched for. template, keep_shape,
    height: see `start_of`; the template is song31 by default. seeds: of the runs, the method's by
    default; the start takes the method's. progress: called with the name of every stage that
    begins ("keypoints", "volume", "start", "preparing"), with "start" now and then during it, and
    with "tracking" after each frame, on the way back with "tracking back"; a KeyboardInterrupt
    during tracking ends the tracks after the last whole frame. keypoints: of the sequence's cameras
    and frames; body, start and every frame's pose follow them, too. keep: called about every second
    of tracking with the body, its first pose, and the tracks of the frames since it was called
    last, which are not held in memory if it stores them. Raises UserError; one after the first
    frame ends the tracks, and is the take's `error`.
    """
    method = method_with(method or Method(), keypoints)
    report = progress or (lambda stage: None)
    grid: VoxelGrid | None = None
    start: Start | None = None
    template = template or load_body("song31")
    if given is None:
        check_startable(template)  # before anything that takes time
    witness: KeypointStart | None = None
    if keypoints is not None:
        report("keypoints")
        witness, given = learnt(
            device, sequence, keypoints, template, method, given, selection, height, keep_shape
        )
    if method.uses_voxels or given is None:
        check_cameras(sequence)
        report("volume")
        grid = automatic_grid(sequence, selection, voxel_size, reconstruction, device)
    if given is None:
        assert grid is not None
        report("start")
        start = start_of(
            device, sequence, grid, template, selection, reconstruction,
            height=height, keep_shape=keep_shape, seed=method.filter.search.seed,
            progress=lambda: report("start"),
        )  # fmt: skip
        given = start.body, start.pose
    body, pose = given
    report("preparing")
    began = time.perf_counter()
    tracks, error = track_seeds(
        device, sequence, grid, body, pose, method,
        [method.filter.search.seed] if seeds is None else list(seeds),
        reconstruction, selection, report,
        None if witness is None else witness.observations,
        None if keep is None else lambda parts: keep(body, pose, parts),
    )  # fmt: skip
    return Take(sequence, body, pose, start, tracks, time.perf_counter() - began, error)


def check_cameras(sequence: Sequence) -> None:
    """Raise InputError where voxels would be of one camera alone, which knows no depth."""
    if len(sequence.rig) < 2:
        raise InputError(
            f"{sequence.name}: one camera, {sequence.rig.names[0]}; expected two or more, which "
            "see the person from different sides at the same time"
        )


def track_takes(
    device: Device | NumpyDevice,
    folders: Items[str | Path],
    method: Method | None = None,
    seeds: Items[int] | None = None,
    *,
    n_at_once: int | None = None,
    progress: Callable[[int, str], object] | None = None,
    **settings: Any,
) -> Iterator[tuple[int, Take | UserError]]:
    """Yield number and result of `track_take` of the sequence in every folder, with these
    `settings` of it, as they are done, in any order. One that fails gives its error and stops no
    other.

    progress: as of `track_take`, called with the folder's number first, in several threads. See
    `at_once` for interrupts.
    """

    def work(own: Device | NumpyDevice, number: int, check: Callable[[], None]) -> Take:
        def report(stage: str) -> None:
            check()
            if progress is not None:
                progress(number, stage)

        sequence = Sequence.open(folders[number])
        return track_take(own, sequence, method, seeds, progress=report, **settings)

    return at_once(device, work, len(folders), n_at_once)


def default_at_once(device: Device | NumpyDevice) -> int:
    """Return how many takes at a time pay, see `BatchConfig`."""
    config = BatchConfig()
    return config.on_gpu if isinstance(device, Device) and device.is_gpu else config.on_cpu


def at_once(
    device: Device | NumpyDevice,
    work: Callable[[Device | NumpyDevice, int, Callable[[], None]], R],
    n_takes: int,
    n_at_once: int | None = None,
) -> Generator[tuple[int, R | UserError], None, None]:
    """Yield every take's number with what `work(device, number, check)` returned or the UserError
    that it raised, as they are done; `n_at_once` at a time, each in a thread with a queue of its
    own on the device.

    After a KeyboardInterrupt, here or in a thread, no take is begun, `check()` raises it in every
    thread, and so does this function once the last one has ended. Any other exception ends all
    work likewise and is raised. So does closing the iterator.
    """
    interrupted = threading.Event()

    def check() -> None:
        if interrupted.is_set():
            raise KeyboardInterrupt

    def one(number: int) -> tuple[int, R | UserError]:
        check()
        try:
            own = device.sibling() if isinstance(device, Device) else device
            return number, work(own, number, check)
        except UserError as error:
            return number, error
        except BaseException:
            interrupted.set()  # before this thread begins another
            raise

    workers = n_at_once or default_at_once(device)
    with ThreadPoolExecutor(workers, thread_name_prefix="apf-take") as pool:
        try:
            waiting = {pool.submit(one, number) for number in range(n_takes)}
            while waiting:
                try:
                    # Not for long: an interrupt just before it waits does not wake it.
                    done, waiting = wait(waiting, 0.5, FIRST_COMPLETED)
                except KeyboardInterrupt:
                    interrupted.set()
                    log.warning("interrupted: takes end after the frame in work")
                    continue
                for future in done:
                    if not isinstance(future.exception(), KeyboardInterrupt):
                        yield future.result()
            check()
        finally:
            interrupted.set()

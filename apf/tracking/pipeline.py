"""The stage `track`: reconstruct and track frame by frame."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator
from collections.abc import Sequence as Items
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import version
from itertools import takewhile
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np

from apf.backend import make_feature_observer
from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.filters.base import Estimate
from apf.filters.method import Method
from apf.initialisation.personal import Outlines, find_outline_pixels, find_outlines
from apf.initialisation.sequence import check_rate
from apf.likelihood.observations import (
    Observation,
    Observed,
    PointObservations,
    Shown,
    split_observation,
)
from apf.scene import Scene
from apf.tracking.limb_confidence import limb_margins
from apf.tracking.recovery import make_recovering_tracker, with_seeds
from apf.tracking.track import Track, concatenate_tracks
from apf.tracking.two_way import TwoWays
from apf.tracking.uncertainty import joint_covariance
from cl import InputError, UserError
from psfs.common.outputs import PART_SECONDS
from psfs.people.separation import PersonSession
from psfs.reconstructor import Reconstructor
from psfs.sequence import Frame
from psfs.session import Session
from psfs.silhouettes.hidden import UNKNOWN
from psfs.volume import automatic_grid
from psfs.voxels.body_prior import TrackedBody
from psfs.voxels.device_voxels import Voxels
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.host_voxels import HostVoxels

#: The observed points of a frame, by its number.
FrameKeypoints: TypeAlias = Callable[[int], PointObservations]
#: Receives the next chunk of each seed's track; returns the files that it wrote, or None if it
#: wrote none.
KeepParts: TypeAlias = Callable[[Items[Track]], "Items[Path] | None"]


@dataclass(frozen=True, eq=False)
class TrackingTask:
    """A body to track, from `pose` (D,) on, by `method`, with one track for each of `seeds`.
    keypoints: returns the observed points of a frame, by its number. frame: number of the frame
    that shows the pose, from which, or the next one of the session's, the body is tracked to both
    ends of the take; by default the first one. tracked: the body in an earlier pass, as a prior of
    the silhouettes and voxels."""

    body: BodyModel
    pose: np.ndarray
    method: Method
    seeds: list[int]
    keypoints: FrameKeypoints | None = None
    frame: int | None = None
    tracked: TrackedBody | None = None


@dataclass(frozen=True, eq=False)
class Tracked:
    """The track of each seed, and the error that ended the tracks early, if there was one."""

    tracks: list[Track]
    error: UserError | None = None


@dataclass(frozen=True, eq=False)
class TrackingRun:
    """A task in a session's frames. keep: called about once per second with the tracks of the
    frames since its last call, which it may store; stored files are read again at the end.
    outlines: receives those of every frame's silhouettes, by its number."""

    session: Session
    task: TrackingTask
    keep: KeepParts | None = None
    outlines: dict[int, Outlines] | None = None


def track_people(
    runs: Items[TrackingRun], progress: Callable[[str], object] | None = None
) -> list[Tracked]:
    """Track the bodies of one person or several, all seeds of all people from one reconstruction.

    The noise grows with the time between frames, see `BodyModel.sigma`. progress: called with
    "tracking" after each frame of the forward pass and with "tracking back" after each frame of the
    backward pass of each person, see `TwoWays`. A KeyboardInterrupt ends the tracks after the last
    complete frame, and is raised again if the first person has none; who has none then, and all who
    follow, are left out. Any other error ends them likewise and is returned.
    """
    people = [_Person(run, progress or (lambda stage: None)) for run in runs]
    try:
        error = _sweep(people, backward=False) or _sweep(people, backward=True)
    finally:
        for person in people:
            person.find_outlines()
    if not people[0].parts:
        raise error or InputError("there is no frame to track; expected at least one")
    return [person.join(error) for person in takewhile(lambda each: each.parts, people)]


def _sweep(people: Items[_Person], backward: bool) -> KeyboardInterrupt | UserError | None:
    """Track everybody from their first poses on, or back; return what ended this early."""
    sought = [person for person in people if person.begin(backward)]
    ended: KeyboardInterrupt | UserError | None = None
    try:
        for index, observed in _observe_people(sought):
            for person, observation in zip(sought, observed, strict=True):
                if index in person.frames:
                    person.step(index, observation)
    except (KeyboardInterrupt, UserError) as error:
        ended = error
    for person in sought:
        try:
            person.finish(whole=ended is None)
        except (KeyboardInterrupt, UserError) as error:
            ended = error
    return ended


class _Person:
    """A run, with its trackers and their tracks in chunks, so that a long run holds only its rows
    in memory, or none if they are stored.

    frames: of the current sweep. parts: the first frame and the chunk of each seed's track; some
    are files."""

    def __init__(self, run: TrackingRun, report: Callable[[str], object]) -> None:
        session, method = run.session, run.task.method
        check_rate(session.sequence, session.frames.step)
        grid = automatic_grid(session) if method.uses_voxels else None
        self.run, self.frames, self._report = run, session.frames, report
        self._method = method.replace(filter=method.filter.scale_to_rate(session.rate))
        self._scene = Scene(session.device, session.rig, grid, run.task.body)
        self._provenance = _provenance(session, run.task, grid)
        self._pool = ThreadPoolExecutor(1)  # more would wait for Python's lock
        self._outlines: dict[int, Future[list[np.ndarray]]] = {}
        self.parts: list[tuple[int, Items[Track | Path]]] = []
        self._begin_part()

    def begin(self, backward: bool) -> bool:
        """Put new trackers at the first pose; return whether there are frames on this side."""
        task, session = self.run.task, self.run.session
        frames = session.frames
        ahead = 0 if task.frame is None else -((frames.start - task.frame) // frames.step)
        first = min(ahead, len(frames) - 1)
        self.frames = frames[:first][::-1] if backward else frames[first:]
        if not self.frames:
            return False
        methods = with_seeds(self._method, task.seeds)
        self._trackers = [make_recovering_tracker(self._scene, seeded) for seeded in methods]
        for tracker in self._trackers:
            tracker.start(task.pose)
        self._ways: TwoWays | None = None
        if task.method.goes_back:
            back = [make_recovering_tracker(self._scene, seeded) for seeded in methods]
            self._ways = TwoWays(
                session.device, self._trackers, back, self._add, self._report, fps=session.rate
            )
        return True

    def step(self, index: int, observation: Observation) -> None:
        """Track the next frame."""
        if self.run.outlines is not None:
            voxels = cast("Voxels | HostVoxels", split_observation(observation)[0])
            if (counts := voxels.download_evidence()) is not None:
                self._outlines[index] = self._pool.submit(_find_outline_pixels, counts)
        if self._ways is not None:
            self._ways.step(index, observation)
        else:
            self._add(index, [tracker.step(observation) for tracker in self._trackers])
            self._report("tracking")

    def finish(self, whole: bool) -> None:
        """End the sweep. whole: whether nothing ended it early."""
        try:
            if self._ways is not None:
                self._ways.finish()
        except (KeyboardInterrupt, UserError):
            whole = False
            raise
        finally:
            self._end_part(whole)

    def _begin_part(self) -> None:
        self._numbers, self._estimates = list[int](), list[list[Estimate]]()
        self._until = time.perf_counter() + PART_SECONDS

    def _add(self, index: int, estimates: list[Estimate]) -> None:
        self._numbers.append(index)
        self._estimates.append(estimates)
        if time.perf_counter() > self._until:
            self._end_part(keep=True)

    def _end_part(self, keep: bool) -> None:
        numbers, order = self._numbers, slice(None, None, 1 if self.frames.step > 0 else -1)
        runs = zip(*self._estimates[order], strict=True)
        self._begin_part()
        if not numbers:
            return
        body, fps = self.run.task.body, self.run.session.sequence.fps
        tracks = [
            build_track(body, fps, numbers[order], list(run), made)
            for made, run in zip(self._provenance, runs, strict=True)
        ]
        self.parts.append((min(numbers), tracks))
        if keep and self.run.keep is not None:
            self.parts[-1] = min(numbers), self.run.keep(tracks) or tracks

    def find_outlines(self) -> None:
        """Complete the outlines of the run."""
        with self._pool:
            pixels = [each.result() for each in self._outlines.values()]
        if self.run.outlines is not None:
            outlines = find_outlines(self.run.session.rig, pixels)
            self.run.outlines.update(zip(self._outlines, outlines, strict=True))

    def join(self, error: BaseException | None) -> Tracked:
        """Return the tracks of all chunks."""
        chunks = [part for _, part in sorted(self.parts, key=lambda each: each[0])]
        tracks = [concatenate_tracks(run).judged for run in zip(*chunks, strict=True)]
        if isinstance(error, KeyboardInterrupt):
            tracks = [track.as_interrupted for track in tracks]
        return Tracked(tracks, error if isinstance(error, UserError) else None)


def _find_outline_pixels(counts: np.ndarray) -> list[np.ndarray]:
    return find_outline_pixels(counts > 0, counts != UNKNOWN)


def _observe_people(people: Items[_Person]) -> Iterator[tuple[int, list[Observation]]]:
    """Yield the number of every frame that anybody of `people` needs, and what each is seen by."""
    if not people:
        return
    session, task = people[0].run.session, people[0].run.task
    everything = {index for person in people for index in person.frames}
    frames = sorted(everything, reverse=people[0].frames.step < 0)
    if all(person.run.session is session for person in people):
        alone = observations(session, task, frames)
        yield from ((index, [observation] * len(people)) for index, observation in alone)
        return
    divided: Iterator[tuple[int, Items[Shown]]]
    if isinstance(session, PersonSession) and task.method.uses_voxels:
        everybody = observe_frames(session.joint.begin(), session.sequence.select_frames(frames))
        divided = ((index, session.joint.divide(index)) for index, _ in everybody)
    else:
        divided = ((index, [None] * len(people)) for index in frames)
    for index, parts in divided:
        observed = list[Observation]()
        for person in people:
            piece, divided_session = None, person.run.session
            if isinstance(divided_session, PersonSession):
                piece = parts[divided_session.number]
            if piece is not None:
                divided_session.record_carved(index, cast("Voxels | HostVoxels", piece))
            observed.append(_add_keypoints(person.run.task, index, piece))
        yield index, observed


def _add_keypoints(task: TrackingTask, index: int, shown: Shown) -> Observation:
    return shown if task.keypoints is None else Observed(shown, task.keypoints(index))


def observations(
    session: Session, task: TrackingTask, frames: Items[int] | None = None
) -> Iterator[tuple[int, Observation]]:
    """Yield number and observation of `frames`, by default every frame of the session, with
    keypoints. Frames that the session is asked to keep are kept while they are carved."""
    frames = session.frames if frames is None else frames
    method = task.method
    observed: Iterator[tuple[int, Shown]]
    if method.objective == "keypoints":
        observed = ((index, None) for index in frames)
    else:
        observe: Callable[[Frame], Shown]
        if method.uses_voxels:
            observe = session.reconstructor(automatic_grid(session), task.tracked)
        else:
            silhouette = session.reconstruction.silhouette
            observe = make_feature_observer(session.device, session, method.features, silhouette)
        observed = observe_frames(observe, session.sequence.select_frames(frames))
        if method.uses_voxels and task.tracked is None:
            observed = _keep_in_session(session, observed)
    return ((index, _add_keypoints(task, index, shown)) for index, shown in observed)


def _keep_in_session(
    session: Session, observed: Iterable[tuple[int, Shown]]
) -> Iterator[tuple[int, Shown]]:
    """Yield the items of `observed`, after the session has kept those that it is asked to keep."""
    for index, voxels in observed:
        session.record_carved(index, cast("Voxels | HostVoxels", voxels))
        yield index, voxels


def _provenance(
    session: Session, task: TrackingTask, grid: VoxelGrid | None
) -> list[dict[str, object]]:
    """Return the provenance of each seed's track."""
    provenance: dict[str, Any] = {
        "sequence": str(session.sequence.folder),
        "device": session.device.name,
        "version": version("psfs-apf"),
    }
    if grid is not None:
        provenance["grid"] = {
            "origin": grid.origin.tolist(),
            "voxel_size": grid.voxel_size,
            "shape": list(grid.shape),
        }
    return [{**provenance, **seeded.describe()} for seeded in with_seeds(task.method, task.seeds)]


def observe_frames(
    observe: Callable[[Frame], Shown], frames: Iterable[Frame]
) -> Iterator[tuple[int, Shown]]:
    """Yield number and observation of every frame; an `observe` that can stream works ahead of
    them.

    A KeyboardInterrupt while the next frame is read is raised after the frame before it is yielded.
    """
    interrupts: list[KeyboardInterrupt] = []

    def hold_interrupts() -> Iterator[Frame]:
        try:
            yield from frames
        except KeyboardInterrupt as interrupt:
            interrupts.append(interrupt)

    if isinstance(observe, Reconstructor):
        for voxels in observe.stream(hold_interrupts()):
            assert voxels.frame is not None
            yield voxels.frame.index, voxels
        if interrupts:
            raise interrupts[0]
    else:
        for frame in frames:
            yield frame.index, observe(frame)


def build_track(
    body: BodyModel,
    fps: float,
    frames: list[int],
    estimates: list[Estimate],
    provenance: dict[str, Any],
) -> Track:
    """Return the track of these estimates, one per frame. provenance: see `Track`."""

    def stack(name: str) -> np.ndarray:
        return np.stack([getattr(estimate, name) for estimate in estimates])

    poses = stack("pose")
    names = ("ess", "beta", "deviation", "misfit", "confidence", "lost", "present", "restart")
    diagnostics: dict[str, Any] = {name: stack(name) for name in names}
    # The log weight of the best particle at exponent 1, Song et al. eq. (16).
    diagnostics["best_log_weight"] = -stack("least_error")
    refined = stack("information"), stack("deviation")
    covariance = joint_covariance(body, poses, *refined, misfit=diagnostics["misfit"])
    diagnostics["covariance"] = np.where(
        diagnostics["lost"][:, None, None, None], np.nan, covariance
    )
    chosen_from = stack("candidates"), stack("candidate_errors")
    diagnostics["limb_margin"] = limb_margins(body, poses, *chosen_from)
    if estimates[0].disagreement is not None:
        diagnostics["limb_disagreement"] = stack("disagreement")
    return Track(
        body_name=body.name,
        dof_names=body.dof_names,
        joint_names=tuple(body.joint_names),
        fps=fps,
        frames=np.array(frames),
        poses=poses,
        joints=posed_joints(body, poses),
        edges=np.array(body.edges),
        diagnostics=diagnostics,
        provenance=json.dumps(provenance),
        body=body,
    )

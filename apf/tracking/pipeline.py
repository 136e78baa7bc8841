"""The stage `track`: reconstruct and track frame by frame."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator
from collections.abc import Sequence as Items
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import version
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
from apf.tracking.recovery import RecoveringRuns
from apf.tracking.track import Track, concatenate_tracks
from apf.tracking.trackers import make_recovering_runs, make_recovering_tracker, with_seeds
from apf.tracking.two_way import track_both_ways
from apf.tracking.uncertainty import joint_covariance
from cl import InputError, UserError
from psfs.people.separation import PersonReconstructor
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

#: Length, s of tracking, of the chunks that are stored together.
PART_SECONDS = 1.0


@dataclass(frozen=True, eq=False)
class TrackingTask:
    """A body to track, from `pose` (D,) on, by `method`, with one track for each of `seeds`.
    keypoints: returns the observed points of a frame, by its number. frame: number of the frame
    that shows the pose, from which the body is tracked to both ends of the take; by default the
    first one. tracked: the body in an earlier pass, as a prior of the silhouettes and voxels."""

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


def track_frames(
    session: Session,
    task: TrackingTask,
    progress: Callable[[str], object] | None = None,
    keep: KeepParts | None = None,
    outlines: dict[int, Outlines] | None = None,
) -> Tracked:
    """Track a body through the session's frames, all seeds from one reconstruction.

    The noise grows with the time between frames, see `BodyModel.sigma`. progress: called with
    "tracking" after each frame of the forward pass and with "tracking back" after each frame of the
    backward pass, see `track_both_ways`. keep: called about once per second with the tracks of the
    frames since its last call, which it may store; stored files are read again at the end. A
    KeyboardInterrupt ends the tracks after the last complete frame, and is raised again if there is
    none. Any other error ends them likewise and is returned. outlines: receives those of every
    frame's silhouettes, by its number.
    """
    sequence, method = session.sequence, task.method
    check_rate(sequence, session.frames.step)
    grid = automatic_grid(session) if method.uses_voxels else None
    scaled = method.replace(filter=method.filter.scale_to_rate(session.rate))
    scene = Scene(session.device, session.rig, grid, task.body)
    report = progress or (lambda stage: None)

    def estimate(frames: range) -> Iterator[tuple[int, list[Estimate]]]:
        tracker = make_recovering_runs(scene, scaled, task.seeds)
        tracker.start(task.pose)
        seen = observations(session, task, frames)
        if outlines is not None:
            seen = _record_outlines(session, seen, outlines)
        if not method.goes_back:
            return track_forward(tracker, seen, report)
        back = [make_recovering_tracker(scene, of) for of in with_seeds(scaled, task.seeds)]
        return track_both_ways(session.device, tracker, back, seen, report, fps=session.rate)

    described = _provenance(session, task, grid)

    def build_tracks(frames: list[int], estimates: list[list[Estimate]]) -> list[Track]:
        order = slice(None, None, 1 if frames[0] <= frames[-1] else -1)
        runs = zip(*estimates[order], strict=True)
        return [
            build_track(task.body, sequence.fps, frames[order], list(run), made)
            for made, run in zip(described, runs, strict=True)
        ]

    begin = 0 if task.frame is None else session.frames.index(task.frame)
    after = _collect_parts(estimate(session.frames[begin:]), build_tracks, keep)
    if not begin or after.error is not None:
        return after.join()
    before = _collect_parts(estimate(session.frames[:begin][::-1]), build_tracks, keep)
    return _Parts(before.chunks + after.chunks, before.error).join()


def observations(
    session: Session, task: TrackingTask, frames: range | None = None
) -> Iterator[tuple[int, Observation]]:
    """Yield number and observation of `frames`, by default every frame of the session, with
    keypoints. Frames that the session is asked to keep are kept while they are carved."""
    frames = session.frames if frames is None else frames
    method, keypoints = task.method, task.keypoints
    seen: Iterator[tuple[int, Shown]]
    if method.objective == "keypoints":
        seen = ((index, None) for index in frames)
    else:
        observe: Callable[[Frame], Shown]
        if method.uses_voxels:
            observe = session.reconstructor(automatic_grid(session), task.tracked)
        else:
            silhouette = session.reconstruction.silhouette
            observe = make_feature_observer(session.device, session, method.features, silhouette)
        stop = frames.stop if frames.stop >= 0 else None
        chosen = slice(frames.start, stop, frames.step)
        seen = observe_frames(observe, session.sequence.frames(chosen))
        if method.uses_voxels and task.tracked is None:
            seen = _keep_in_session(session, seen)
    if keypoints is None:
        return seen
    return ((index, Observed(shown, keypoints(index))) for index, shown in seen)


def _keep_in_session(
    session: Session, seen: Iterable[tuple[int, Shown]]
) -> Iterator[tuple[int, Shown]]:
    """Yield the items of `seen`, after the session has kept those that it is asked to keep."""
    for index, voxels in seen:
        session.record_carved(index, cast("Voxels | HostVoxels", voxels))
        yield index, voxels


def _record_outlines(
    session: Session, seen: Iterable[tuple[int, Observation]], outlines: dict[int, Outlines]
) -> Iterator[tuple[int, Observation]]:
    """Yield the items of `seen`; find their outlines in another thread and add them to `outlines`
    at the end."""

    def find(counts: np.ndarray) -> list[np.ndarray]:
        return find_outline_pixels(counts > 0, counts != UNKNOWN)

    begun: dict[int, Future[list[np.ndarray]]] = {}
    with ThreadPoolExecutor(1) as pool:  # more would wait for Python's lock
        try:
            for index, shown in seen:
                voxels = cast("Voxels | HostVoxels", split_observation(shown)[0])
                if (counts := voxels.download_evidence()) is not None:
                    begun[index] = pool.submit(find, counts)
                yield index, shown
        finally:
            found = find_outlines(session.rig, [each.result() for each in begun.values()])
            outlines.update(zip(begun, found, strict=True))


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
    return [{**provenance, **of.describe()} for of in with_seeds(task.method, task.seeds)]


def track_forward(
    tracker: RecoveringRuns,
    seen: Iterable[tuple[int, Observation]],
    progress: Callable[[str], object],
) -> Iterator[tuple[int, list[Estimate]]]:
    """Yield the number of every frame of `seen` and each run's estimate of it. The tracker must be
    started.

    progress: called with "tracking" after each frame.
    """
    for index, shown in seen:
        yield index, tracker.step(shown)
        progress("tracking")


@dataclass(frozen=True, eq=False)
class _Parts:
    """The chunks of each seed's track, in the order of their frames; some may be files. error: that
    ended them early, or the user's interrupt."""

    chunks: list[Items[Track | Path]]
    error: BaseException | None = None

    def join(self) -> Tracked:
        """Return the tracks of all chunks. Raises the error if there is none."""
        if not self.chunks:
            raise self.error or InputError("there is no frame to track; expected at least one")
        tracks = [concatenate_tracks(run).judged for run in zip(*self.chunks, strict=True)]
        if isinstance(self.error, KeyboardInterrupt):
            tracks = [track.as_interrupted for track in tracks]
        return Tracked(tracks, self.error if isinstance(self.error, UserError) else None)


def _collect_parts(
    found: Iterator[tuple[int, list[Estimate]]],
    build_tracks: Callable[[list[int], list[list[Estimate]]], list[Track]],
    keep: KeepParts | None,
) -> _Parts:
    """Build the tracks chunk by chunk, so that a long run holds only its rows in memory, or none if
    they are stored; see `track_frames`. Frames ascend or descend."""
    parts: list[Items[Track | Path]] = []
    numbers: list[int] = []
    error: BaseException | None = None
    more = True
    while more:
        frames, estimates, more, error = _track_part(found, PART_SECONDS)
        if not estimates:
            continue
        numbers += frames
        part = build_tracks(frames, estimates)
        parts.append(part)
        if keep is not None and error is None:
            try:
                parts[-1] = keep(part) or part
            except (UserError, KeyboardInterrupt) as failure:
                error, more = failure, False
    return _Parts(parts if numbers == sorted(numbers) else parts[::-1], error)


def _track_part(
    found: Iterator[tuple[int, list[Estimate]]], seconds: float
) -> tuple[list[int], list[list[Estimate]], bool, BaseException | None]:
    """Track for about `seconds`. Return frames, estimates, whether more frames may follow, and the
    error that ended them early."""
    frames: list[int] = []
    estimates: list[list[Estimate]] = []
    until = time.perf_counter() + seconds
    try:
        for index, estimate in found:
            frames.append(index)
            estimates.append(estimate)
            if time.perf_counter() > until:
                return frames, estimates, True, None
    except (KeyboardInterrupt, UserError) as error:
        return frames[: len(estimates)], estimates, False, error
    return frames, estimates, False, None


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

    if isinstance(observe, (Reconstructor, PersonReconstructor)) and observe.streams:
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

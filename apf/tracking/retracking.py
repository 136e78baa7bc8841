"""Tracking the surroundings of corrected frames again, from each corrected frame outwards."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from apf.body.kinematics import posed_joints
from apf.filters.base import Estimate
from apf.filters.method import Method
from apf.likelihood.observations import PointObservations, make_empty_observations
from apf.scene import Scene
from apf.tracking.correction import (
    Correction,
    Corrections,
    correct_pose,
    hold_corrections,
    list_corrections,
    observe_corrections,
)
from apf.tracking.pipeline import TrackingTask, build_track, observations
from apf.tracking.smoothing import unwrap_angles
from apf.tracking.track import Track
from apf.tracking.trackers import make_recovering_tracker
from cl import InputError
from psfs.session import Session
from psfs.volume import automatic_grid
from psfs.voxels.grid import VoxelGrid

#: Frames at each end of what is tracked again over which it passes into the track as it was.
_FADE = 3


@dataclass(frozen=True, eq=False)
class Retracking:
    """A take of which parts are tracked again.

    session: of the whole take. grid: of its voxels; None without voxels. track: as it was. method:
    how it is tracked.
    """

    session: Session
    grid: VoxelGrid | None
    track: Track
    method: Method


def apply_corrections(
    task: Retracking,
    corrections: Corrections,
    progress: Callable[[str], object] = lambda stage: None,
) -> Track:
    """Return the track with corrections applied.

    From each corrected frame the person is tracked forward and backward, up to the next corrected
    frame or as far as the corrections reach. The first pose is that of the track, with the
    corrected joints put right by inverse kinematics; the joints are further observations of their
    frame, which the silhouettes outweigh at most as far as the stated errors reach. Between two
    corrected frames each frame takes the nearer one's estimate. Bad frames are
    lost. progress: called with "tracking" after each frame. Raises InputError.
    """
    track = task.track
    corrections.check(track)
    wanted = corrections.by_frame
    estimates: dict[int, Estimate] = {}
    for frame, stop in find_courses(track, corrections):
        for number, estimate in _follow(task, wanted, frame, stop, progress):
            estimates[number] = estimate
    if estimates:
        track = splice_estimates(track, estimates, list(wanted))
    return mark_bad(_note_corrections(track, corrections), corrections)


def find_courses(track: Track, corrections: Corrections) -> Iterator[tuple[int, int]]:
    """Yield from which corrected frame to which frame the person is tracked again, first backwards,
    then forwards."""
    frames = list(corrections.by_frame)
    known = track.frames
    for number, frame in enumerate(frames):
        reach = corrections.reach * track.fps
        low, high = frame - reach, frame + reach
        if number > 0:
            low = max(low, (frames[number - 1] + frame) / 2)
        if number + 1 < len(frames):
            high = min(high, (frame + frames[number + 1]) / 2)
        inside = known[(known >= low) & (known <= high)]
        yield frame, int(inside[0])
        yield frame, int(inside[-1])


def _follow(
    task: Retracking,
    wanted: dict[int, dict[str, Correction]],
    frame: int,
    stop: int,
    progress: Callable[[str], object],
) -> Iterator[tuple[int, Estimate]]:
    """Yield the estimates of the frames from a corrected one to `stop`, in that direction."""
    track, body = task.track, task.track.its_body
    step = int(np.median(np.diff(track.frames))) if len(track) > 1 else 1
    way = step if stop >= frame else -step
    end = stop + (1 if way > 0 else -1)
    settings = replace(
        task.session.settings, selection=slice(frame, end if end >= 0 else None, way)
    )
    session = Session(task.session.sequence, task.session.device, settings)
    if (background := task.session.background) is not None:
        session.revise_background(background)
    if task.grid is not None:
        session.replace_result(automatic_grid, task.grid)
    rig = session.rig
    seen = {number: observe_corrections(body, rig, joints) for number, joints in wanted.items()}
    nothing = make_empty_observations()

    def points(number: int) -> PointObservations:
        return seen.get(number, nothing)

    method = task.method.with_keypoints(max(len(of) for of in seen.values()))
    scaled = method.replace(filter=method.filter.scale_to_rate(session.rate))
    seed = method.filter.search.seed
    scene = Scene(session.device, rig, task.grid, body)
    tracker = make_recovering_tracker(scene, scaled)
    row = int(np.flatnonzero(track.frames == frame)[0])
    pose = correct_pose(body, track.poses[row], wanted[frame])
    tracker.start(pose)
    run = TrackingTask(body, pose, method, [seed], points)
    for number, observation in observations(session, run):
        estimate = tracker.step(observation)
        if number == frame:  # the others show no correction, see `find_courses`
            estimate = replace(estimate, pose=hold_corrections(body, estimate.pose, wanted[frame]))
            tracker.start(estimate.pose)
        yield number, estimate
        progress("tracking")


def splice_estimates(track: Track, fresh: dict[int, Estimate], corrected: list[int]) -> Track:
    """Return the track with the estimates in place of its own; they fade into it at the ends of
    each stretch, but not within `_FADE` frames of a corrected one."""
    body, numbers = track.its_body, sorted(fresh)
    rows = np.flatnonzero(np.isin(track.frames, numbers))
    estimates, provenance = [fresh[number] for number in numbers], json.loads(track.provenance)
    made = build_track(body, track.fps, numbers, estimates, provenance).judged
    share = _weigh_new_poses(track, rows, corrected)
    poses = track.poses.copy()
    both = np.stack([poses[rows], made.poses])
    away = unwrap_angles(both.swapaxes(0, 1).reshape(-1, both.shape[-1]), body)
    pairs = away.reshape(len(rows), 2, -1)
    poses[rows] = (1 - share)[:, None] * pairs[:, 0] + share[:, None] * pairs[:, 1]
    diagnostics = {}
    for name, values in track.judged.diagnostics.items():
        values = values.copy()
        new = made.diagnostics.get(name)
        if new is not None and new.shape[1:] == values.shape[1:]:
            values[rows] = new
        elif np.issubdtype(values.dtype, np.floating):
            values[rows] = np.nan
        diagnostics[name] = values
    return replace(track, poses=poses, joints=posed_joints(body, poses), diagnostics=diagnostics)


def _weigh_new_poses(track: Track, rows: np.ndarray, corrected: list[int]) -> np.ndarray:
    """Return the share (n,) of the new poses in these rows of the track."""
    ends = np.flatnonzero(np.diff(rows) > 1)
    share, steps = np.ones(len(rows)), _FADE + 1
    for stretch in np.split(np.arange(len(rows)), ends + 1):
        first, last = rows[stretch[0]], rows[stretch[-1]]
        from_start = (rows[stretch] - first + 1) / steps if first > 0 else np.inf
        from_end = (last - rows[stretch] + 1) / steps if last < len(track) - 1 else np.inf
        share[stretch] = np.minimum(1.0, np.minimum(from_start, from_end))
    share[np.isin(track.frames[rows], corrected)] = 1.0
    return share


def mark_bad(track: Track, corrections: Corrections) -> Track:
    """Return the track with the person lost in the bad frames."""
    if not corrections.bad:
        return track
    bad = np.zeros(len(track), bool)
    for first, last in corrections.bad:
        bad |= (track.frames >= first) & (track.frames <= last)
    if bad.all():
        raise InputError("all frames are marked as bad; expected some that are not")
    return replace(track, diagnostics={**track.diagnostics, "lost": track.lost | bad})


def _note_corrections(track: Track, corrections: Corrections) -> Track:
    """Return the track with the corrections in its provenance, after earlier ones."""
    lines = [*list_corrections(track), *corrections.describe()]
    made = {**json.loads(track.provenance), "corrections": lines}
    return replace(track, provenance=json.dumps(made))

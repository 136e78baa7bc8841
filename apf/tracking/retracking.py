"""Corrections of a track by hand: positions of joints, and frames marked as bad. The surroundings
of corrected frames are tracked again, from each corrected frame outwards."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import ConfigDict, Field

from apf.body.kinematics import posed_joints
from apf.body.limbs import limb_bones, solve_inverse_kinematics
from apf.body.model import BodyModel, plain_name
from apf.filters.base import Estimate
from apf.filters.method import Method
from apf.likelihood.observations import PointObservations, make_empty_observations
from apf.scene import Scene
from apf.tracking.pipeline import TrackingTask, build_track, observations
from apf.tracking.recovery import make_recovering_tracker
from apf.tracking.smoothing import unwrap_angles
from apf.tracking.track import Track, spans
from cl import InputError
from psfs.cameras.camera import CameraRig
from psfs.common.files import read_toml, write_toml
from psfs.common.ranges import LARGEST
from psfs.common.schema import Name, PathText, parse_values
from psfs.session import Session
from psfs.volume import automatic_grid
from psfs.voxels.grid import VoxelGrid

#: The defaults of a file of corrections: time before and after a corrected frame, s, that is
#: tracked again; error, m, of a joint placed by hand, as between two people who mark it.
REACH, ERROR = 0.4, 0.02
_Frame = Annotated[int, Field(ge=0, le=2**40, strict=True)]
_Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST, strict=True)]


@dataclass(frozen=True)
class Correction:
    """A joint's right place in one frame: position (3,) m, and how far it may be off, m."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    frame: _Frame
    joint: Name
    position: tuple[_Number, _Number, _Number]
    error: Annotated[float, Field(ge=0.001, le=1.0, strict=True)] = ERROR


@dataclass(frozen=True)
class Corrections:
    """Corrections of a track. track: its folder. point: joints' right places. bad: (first, last)
    numbers of frames in which the person counts as lost. reach: s before and after each corrected
    frame that are tracked again."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    track: PathText
    point: tuple[Correction, ...] = ()
    bad: tuple[tuple[_Frame, _Frame], ...] = ()
    reach: Annotated[float, Field(ge=0.0, le=60.0, strict=True)] = REACH

    def check(self, track: Track) -> None:
        """Raise InputError unless all frames and joints are those of `track`."""
        known = set(track.frames.tolist())
        marked = [(point.frame, point.joint) for point in self.point]
        for frame, joint in dict.fromkeys(marked):
            if marked.count((frame, joint)) > 1:
                raise InputError(f"{joint} is corrected twice in frame {frame}; expected once")
        for point in self.point:
            if point.joint not in track.joint_names:
                raise InputError(
                    f"no joint {point.joint!r}; expected one of {', '.join(track.joint_names)}"
                )
            if point.frame not in known:
                raise InputError(f"frame {point.frame} was not tracked; expected one that was")
        for first, last in self.bad:
            if not track.frames[0] <= first <= last <= track.frames[-1]:
                raise InputError(
                    f"bad frames {first} to {last}; expected the first one first, from "
                    f"{track.frames[0]} to {track.frames[-1]}"
                )

    def check_places(self, grid: VoxelGrid) -> None:
        """Raise InputError if a joint is put farther than 1 m outside of the volume."""
        for point in self.point:
            position = np.array(point.position)
            if np.any(position < grid.origin - 1.0) or np.any(position > grid.high + 1.0):
                raise InputError(
                    f"{point.joint} in frame {point.frame} is put to {position.round(2).tolist()}; "
                    f"expected a place in the volume that was tracked, {grid.origin.round(2)} to "
                    f"{grid.high.round(2)} m"
                )

    @property
    def by_frame(self) -> dict[int, dict[str, Correction]]:
        """The corrected joints of each corrected frame, by name, frames ascending."""
        joints_of: dict[int, dict[str, Correction]] = {}
        for point in sorted(self.point, key=lambda point: point.frame):
            joints_of.setdefault(point.frame, {})[point.joint] = point
        return joints_of

    def describe(self) -> list[str]:
        """Return lines that list them."""
        lines = []
        for frame, joints in self.by_frame.items():
            names = ", ".join(plain_name(name) for name in joints)
            lines.append(f"corrected by hand in frame {frame}: {names}")
        if self.bad:
            frames = [n for first, last in self.bad for n in range(first, last + 1)]
            lines.append(f"marked as bad by hand: frames {spans(sorted(set(frames)))}")
        return lines


def list_corrections(track: Track) -> list[str]:
    """Return the lines that list what was corrected by hand in a track, from its provenance."""
    return [str(line) for line in json.loads(track.provenance).get("corrections", [])]


def read_corrections(path: Path) -> Corrections:
    """Read a file of `write_corrections`. Raises InputError, or MissingFileError."""
    corrections = parse_values(Corrections, read_toml(path), path)
    return replace(corrections, track=path.parent / corrections.track)


def write_corrections(path: Path, corrections: Corrections) -> None:
    """Write corrections as TOML; the track's folder as it is."""
    write_toml(path, asdict(replace(corrections, track=str(corrections.track))))


def observe_corrections(
    body: BodyModel, rig: CameraRig, joints: dict[str, Correction]
) -> PointObservations:
    """Return the sightings of corrected joints, by name: where each camera would see them, with the
    error of the correction in its pixels. Cameras that the point is behind are left out."""
    names = list(joints)
    numbers = [body.joint_names.index(name) for name in names]
    positions = np.array([joints[name].position for name in names], float).reshape(-1, 3)
    errors = np.array([joints[name].error for name in names])
    sightings: list[tuple[int, int, np.ndarray, float]] = []
    for view, camera in enumerate(rig):
        inside = positions @ camera.R.T + camera.t
        for point in np.flatnonzero(inside[:, 2] > errors):
            x, y, depth = inside[point]
            pixel = camera.K[:2, :2] @ (x / depth, y / depth) + camera.K[:2, 2]
            focal = (camera.K[0, 0] + camera.K[1, 1]) / 2
            sightings.append((int(point), view, pixel, float(depth / (focal * errors[point]))))
    return PointObservations(
        bone=np.array([body.joints[number].bone for number in numbers], int),
        position=np.array([body.joints[number].position for number in numbers]).reshape(-1, 3),
        point=np.array([point for point, _, _, _ in sightings], int),
        partner=np.full(len(sightings), -1),
        camera=np.array([view for _, view, _, _ in sightings], int),
        pixel=np.array([pixel for _, _, pixel, _ in sightings], float).reshape(-1, 2),
        inverse_scale=np.array([scale for _, _, _, scale in sightings], float),
        most=len(names) * len(rig),
    )


def correct_pose(body: BodyModel, pose: np.ndarray, joints: dict[str, Correction]) -> np.ndarray:
    """Return a pose (D,) with the joints, by name, put to their places by moving their limbs alone;
    the whole body if one of the joints is on no limb."""
    numbers = [body.joint_names.index(name) for name in joints]
    targets = np.zeros((1, len(body.joints), 3))
    for number, point in zip(numbers, joints.values(), strict=True):
        targets[0, number] = point.position
    wanted = np.isin(np.arange(len(body.joints)), numbers)
    limbs = limb_bones(body)
    moved = [body.joints[number].bone for number in numbers]
    bones: np.ndarray = np.ones(len(body.bones), bool)
    if len(limbs) and all(limbs[:, bone].any() for bone in moved):
        bones = np.any(limbs[limbs[:, moved].any(axis=1)], axis=0)
    free = np.zeros(body.n_dof, bool)
    for bone, chosen in zip(body.bones, bones, strict=True):
        for axis in bone.axes:
            free[axis.dof] |= bool(chosen)
    poses: np.ndarray = solve_inverse_kinematics(body, pose[None], free, wanted, targets, near=1e-3)
    return poses[0]


def hold_corrections(
    body: BodyModel, pose: np.ndarray, joints: dict[str, Correction]
) -> np.ndarray:
    """Return a pose (D,) whose corrected joints, by name, are no farther from their places than the
    stated errors: each joint that is goes to its error's edge by `correct_pose`."""
    joints_now = dict(zip(body.joint_names, posed_joints(body, pose[None])[0], strict=True))
    held, far = dict[str, Correction](), False
    for name, point in joints.items():
        goal = np.array(point.position)
        off = joints_now[name] - goal
        share = point.error / max(float(np.linalg.norm(off)), point.error)
        far |= share < 1
        x, y, z = (goal + share * off).tolist()
        held[name] = replace(point, position=(x, y, z))
    return correct_pose(body, pose, held) if far else pose


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

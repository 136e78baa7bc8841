"""Tracking a take forward and back, and what both ways say together.

A filter knows the past only: an arm that comes out from before the trunk is found again when it
shows, and was wrong until then. From the end of the take back it is the other way round. As in a
two-filter smoother (Fraser & Potter 1969, "The optimum linear smoother as a combination of two
optimum linear filters") both say what each of them saw; where they agree within a limb's breadth
the mean of both is taken, whose errors are smaller, and elsewhere the way that fits the pictures
better over the frames on end (Viterbi 1967).

Long takes are worked on in windows that overlap, for the observations of a window are held in
memory. Live there is no way back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from apf.body.kinematics import posed_joints
from apf.body.limbs import limb_ends, limb_joints, limb_masks, reaching
from apf.body.model import BodyModel
from apf.filters.base import Estimate
from apf.initialisation.kept_voxels import CroppedVoxels, RestoredVoxels, cropped
from apf.likelihood.observations import parted, with_points
from apf.tracking.recovery import Watched
from apf.tracking.smoothing import unwrapped
from cl import Device, NumpyDevice, UserError
from psfs.common.ranges import check_range

#: A frame of a window: its number, what was observed, and each run's estimate.
Seen = tuple[int, Any, list[Estimate]]


@dataclass(frozen=True)
class TwoWayConfig:
    """How both ways are made one. Raises InputError where a value makes no sense."""

    near: float = 0.15
    """m, joints of both ways that are nearer are the same: their mean is taken. Tuned on
    synth_box_4cam and synth_salsa_4cam_hd: 0.1 is nearly as good."""
    jump: float = 0.05
    """m by which joints jump where the way changes, on average ..."""
    misfit: float = 0.05
    """... which costs as much as this error, in the likelihood's unit, in one frame. Three times as
    much or as little changes nothing."""
    overlap: int = 30
    """Frames that the way back goes before a window's poses are final; a third of a short one's."""
    memory: float = 0.5
    """GB of observations in a window: of 4 cameras of 640 x 480 some 500 frames where silhouettes
    are clean, of 4 of 1920 x 1080 with specks all over 17."""
    longest: int = 1000
    """Frames of a window, at most."""

    def __post_init__(self) -> None:
        for name in ("near", "jump", "misfit", "memory"):
            check_range(f"two ways: {name}", getattr(self, name), 0)
        for name in ("overlap", "longest"):
            check_range(f"two ways: {name}", getattr(self, name), 1, ends=True)

    def full(self, n_frames: int, n_bytes: int) -> bool:
        """Return whether a window of so many frames and bytes has room for no other."""
        return n_frames >= self.longest or (n_frames > 2 and n_bytes > 1e9 * self.memory)


def both_ways(
    device: Device | NumpyDevice,
    forward: Any,
    back: Sequence[Watched],
    seen: Iterable[tuple[int, Any]],
    progress: Callable[[str], object],
    config: TwoWayConfig | None = None,
) -> Iterator[tuple[int, list[Estimate]]]:
    """Yield number and each run's estimate of every frame of `seen`.

    forward: the runs, which have started (`WatchedRuns`, say); back: a tracker for each of them.
    progress: called with "tracking" or "tracking back" after each frame. What ends the frames
    early, an interrupt or an error, is raised after those before it; one on the way back leaves the
    window as it was tracked forward.
    """
    config = config or TwoWayConfig()
    window, frames = list[Seen](), iter(seen)
    ended: BaseException | None = None
    whole = False
    while True:
        n_bytes = sum(_n_bytes(kept) for _, kept, _ in window)
        try:
            for index, shown in frames:
                estimates = forward.step(shown)
                window.append((index, _kept(device, shown), estimates))
                n_bytes += _n_bytes(window[-1][1])
                progress("tracking")
                if config.full(len(window), n_bytes):
                    break
            else:
                whole = True
        except (KeyboardInterrupt, UserError) as error:
            ended, whole = error, True
        n_final = len(window) if whole else len(window) - min(config.overlap, len(window) // 3)
        try:
            told = partial(progress, "tracking back")
            final = _smoothed(device, back, window, n_final, config, told)
        except (KeyboardInterrupt, UserError) as error:
            ended, final = error, [[_alone(one) for one in estimates] for _, _, estimates in window]
        for (index, _, _), estimates in zip(window, final, strict=False):
            yield index, estimates
        if ended is not None:
            raise ended
        if whole:
            return
        del window[:n_final]


def _kept(device: Device | NumpyDevice, observation: Any) -> Any:
    """What remains of an observation when the next one is made."""
    shown, points = parted(observation)
    return with_points(None if shown is None else cropped(device, shown), points)


def _n_bytes(kept: Any) -> int:
    shown = parted(kept).shown
    return shown.nbytes if isinstance(shown, CroppedVoxels) else 0


def _backwards(device: Device | NumpyDevice, window: list[Seen]) -> Iterator[Any]:
    """The observations of a window again, the last one first; each overwrites the one before."""
    parts = [parted(kept) for _, kept, _ in reversed(window)]
    crops = [shown for shown, _ in parts if isinstance(shown, CroppedVoxels)]
    restored = RestoredVoxels(device, crops) if crops and isinstance(device, Device) else None
    for shown, points in parts:
        if restored is not None and isinstance(shown, CroppedVoxels):
            shown = restored.show(shown)
        yield with_points(shown, points)


def _smoothed(
    device: Device | NumpyDevice,
    back: Sequence[Watched],
    window: list[Seen],
    n_final: int,
    config: TwoWayConfig,
    progress: Callable[[], object],
) -> list[list[Estimate]]:
    """Each run's estimates of the first `n_final` frames of a window, by both ways."""
    if not window:
        return []
    ways: list[list[tuple[Estimate, np.ndarray]]] = [[] for _ in back]
    for tracker, last in zip(back, window[-1][2], strict=True):
        tracker.start(last.pose)
    for observation, (_, _, estimates) in zip(
        _backwards(device, window), reversed(window), strict=True
    ):
        for way, tracker, ahead in zip(ways, back, estimates, strict=True):
            behind = tracker.step(observation)
            errors = tracker.errors_of(exchanged(behind.body, ahead.pose, behind.pose, config))
            way.append((behind, errors))
        progress()
    by_run, final = [], slice(n_final)
    for run, way in enumerate(ways):
        by_ahead = [estimates[run] for _, _, estimates in window[final]]
        by_behind = [behind for behind, _ in reversed(way)][final]
        errors = np.stack([errors for _, errors in reversed(way)][final])
        by_run.append(combined(by_ahead, by_behind, errors, config))
    return [list(estimates) for estimates in zip(*by_run, strict=True)]


def _alone(estimate: Estimate) -> Estimate:
    """An estimate that no other way agrees or disagrees with."""
    return replace(estimate, disagreement=np.full(len(limb_ends(estimate.body)), np.nan))


def exchanged(
    body: BodyModel, ahead: np.ndarray, behind: np.ndarray, config: TwoWayConfig | None = None
) -> np.ndarray:
    """Return the poses (2 + 2 L, D) that are compared: both ways' (D,), then `ahead` with each of
    the L limbs of `behind` where that has it, and the other way round; by their angles those that
    are at nearly the same places, for their mean is taken."""
    both, limbs, joints = np.stack([ahead, behind]), limb_masks(body), limb_joints(body)
    mixed = np.concatenate([np.where(limbs, behind, ahead), np.where(limbs, ahead, behind)])
    places = posed_joints(body, both)
    apart = np.linalg.norm(places[0] - places[1], axis=-1)
    far = np.any(joints & (apart > (config or TwoWayConfig()).near / 2), axis=1)
    for way, other in enumerate(places[::-1]):
        rows = way * len(limbs) + np.flatnonzero(far)
        there = np.tile(other, (len(rows), 1, 1))
        mixed[rows] = reaching(body, mixed[rows], limbs[far], joints[far], there)
    return np.concatenate([both, mixed])


def combined(
    ahead: Sequence[Estimate],
    behind: Sequence[Estimate],
    errors: np.ndarray,
    config: TwoWayConfig | None = None,
) -> list[Estimate]:
    """Return the estimates of frames on end by both ways, one of each way per frame.

    errors: (F, 2 + 2 L) of the poses that `exchanged` returns. Trunk and limbs are chosen one by
    one. `disagreement` is how far the ends of the limbs are apart.
    """
    ways, body = _Ways(ahead, behind, config or TwoWayConfig()), ahead[0].body
    of_limb, limbs = limb_joints(body), limb_masks(body)
    rows, trunk = np.arange(len(ahead)), ~np.any(of_limb, axis=0)
    trunk |= ~trunk.any()  # of a body that has no joint but its limbs'
    whole = ways.better(errors[:, :2], ways.joints[:2, :, trunk])
    taken = ways.taken(whole, trunk)
    pose, deviation = ways.poses[taken, rows], ways.deviations[taken, rows]
    own = errors[rows, whole]
    for limb, (joints, dofs) in enumerate(zip(of_limb, limbs, strict=True)):
        # The limb of the other way on the trunk of the chosen one.
        other = errors[rows, 2 + len(limbs) * whole + limb]
        by_way = np.where(whole[:, None] == [0, 1], own[:, None], other[:, None])
        poses = np.stack([
            reaching(body, np.where(dofs, limb_of, pose), dofs, joints, places)
            for limb_of, places in zip(ways.poses, ways.joints, strict=True)
        ])  # fmt: skip
        # There it jumps, too, where the trunk's way changes.
        places = np.stack([posed_joints(body, way)[:, joints] for way in poses[:2]])
        taken = ways.taken(ways.better(by_way, places), joints)
        pose[:, dofs] = poses[taken, rows][:, dofs]
        deviation[:, dofs] = ways.deviations[taken, rows][:, dofs]
    return [
        _alone((ahead, behind)[way][row]) if ways.lost[row].all()
        else replace(
            (ahead, behind)[way][row],
            pose=pose[row], deviation=deviation[row], disagreement=ways.apart[row],
        )
        for row, way in enumerate(whole)
    ]  # fmt: skip


class _Ways:
    """Poses and deviations (3, F, D) and joints (3, F, J, 3) m of both ways and their mean, in
    which frames (F, 2) they have lost the person, and how far the limbs' ends (F, L) are apart,
    m."""

    def __init__(
        self, ahead: Sequence[Estimate], behind: Sequence[Estimate], config: TwoWayConfig
    ) -> None:
        self._config, body, ways = config, ahead[0].body, (ahead, behind)
        poses = np.stack([[estimate.pose for estimate in way] for way in ways])
        poses = unwrapped(poses, body)  # from one way to the other
        deviations = np.stack([[estimate.deviation for estimate in way] for way in ways])
        joints = np.stack([posed_joints(body, of) for of in poses])
        self.lost = np.array([[estimate.lost for estimate in way] for way in ways]).T
        self.poses = np.stack([*poses, poses.mean(0)])
        self.deviations = np.stack([*deviations, np.linalg.norm(deviations, axis=0) / 2])
        self.joints = np.stack([*joints, joints.mean(0)])
        off = posed_joints(body, self.poses[2]) - self.joints[2]
        self._mean_off = np.linalg.norm(off, axis=-1)
        self._apart = np.linalg.norm(joints[0] - joints[1], axis=-1)
        self.apart = self._apart[:, limb_ends(body)]
        self.apart[self.lost.any(1)] = np.nan

    def better(self, misfits: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Return the better way (F,), 0 or 1, by misfits (F, 2) and the jumps of joints, whose
        `places` (2, F, K, 3) are those of each way, m."""
        costs = misfits / self._config.misfit
        costs += 1e6 * (self.lost & ~self.lost.all(1, keepdims=True))
        jumps = np.linalg.norm(places[None, :, 1:] - places[:, None, :-1], axis=-1).mean(-1)
        return best_path(costs, np.moveaxis(jumps, -1, 0) / self._config.jump)

    def taken(self, way: np.ndarray, of: np.ndarray) -> np.ndarray:
        """Return a way (F,), or 2, the mean, where both ways have the joints `of` (J,) at the same
        places and the mean pose has them between these."""
        near = self._config.near
        agreed = (self._apart[:, of].max(1) < near) & (self._mean_off[:, of].max(1) < near / 4)
        return np.where(agreed & ~self.lost.any(1), 2, way)


def best_path(costs: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Return the states (F,) of least cost (Viterbi 1967): costs (F, K) of being in each, and
    changes (F - 1, K, K) of going from one to another."""
    n_frames, total = len(costs), costs[0].copy()
    come_from = np.zeros(costs.shape, int)
    for frame in range(1, n_frames):
        reached = total[:, None] + changes[frame - 1]
        come_from[frame] = reached.argmin(0)
        total = reached.min(0) + costs[frame]
    path = np.empty(n_frames, int)
    path[-1] = total.argmin()
    for frame in range(n_frames - 1, 0, -1):
        path[frame - 1] = come_from[frame, path[frame]]
    return path

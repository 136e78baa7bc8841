"""Fusion of a forward and a backward pass over a take.

A filter knows only the past: if an arm comes out from in front of the trunk, the filter finds it
then, and was wrong before. A backward pass from the end of the take has the opposite weakness. As
in a two-filter smoother (Fraser & Potter 1969, "The optimum linear smoother as a combination of two
optimum linear filters") the two passes are combined. If they agree to within `SAME_PLACE`, average
them, which reduces the error; otherwise use the pass with the lower image error over consecutive
frames (Viterbi 1967).

A long take is processed in overlapping windows, because the observations of a window are held in
memory. Live tracking has no backward pass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from apf.body.kinematics import posed_joints
from apf.body.limbs import limb_ends, limb_joints, limb_masks, solve_inverse_kinematics
from apf.body.model import BodyModel
from apf.filters.base import Estimate
from apf.initialisation.kept_voxels import (
    CroppedVoxels,
    RestoredVoxels,
    crop_voxels,
    store_voxels,
)
from apf.likelihood.observations import (
    Observation,
    PointObservations,
    Shown,
    split_observation,
    with_points,
)
from apf.tracking.limb_confidence import LEAST_DISTANCE, SAME_PLACE
from apf.tracking.recovery import RecoveringTracker
from apf.tracking.smoothing import unwrap_angles
from cl import Device, NumpyDevice, UserError
from psfs.common.numbers import find_best_path, find_true_runs, smooth_locally
from psfs.voxels.device_voxels import Voxels
from psfs.voxels.host_voxels import HostVoxels

#: Mean jump, m, of the joints where the pass changes that costs as much as an error of 1 of a
#: frame, in the likelihood's unit; three times as much or as little changes nothing.
_JUMP_PER_ERROR = 0.6
#: Time, s, of the Savitzky-Golay window that smooths the poses; longer ones flatten fast motion.
#: Largest distance, m, of a limb's joints from their smoothed positions.
SMOOTHED_SECONDS, _SMOOTHED_WITHIN = 0.15, 0.01
#: Frames at the end of a window, or of a chunk, that are tracked again in the next one, so that the
#: pass has converged where poses become final; at most a third of the window.
OVERLAP = 30
#: Largest window: bytes of its observations, about 500 frames of 4 cameras of 640 x 480 with clean
#: silhouettes; frames, if the observations are keypoints alone.
MOST_BYTES, MOST_FRAMES = 500_000_000, 1000
#: Number of a window's last frames whose crops are not waited for.
_CROPPING = 8
#: One frame of a window: its number, its observation, and the estimate of each track.
_WindowFrame = tuple[int, "_Kept", list[Estimate]]


class TwoWays:
    """Tracking of frames by `forward`, the started tracker of each track, and by `back`, that of
    the backward pass of each; `fps` frames per second.

    add: receives the number of every frame and each track's estimate of it, in the frames' order.
    progress: called with "tracking" or "tracking back" after each frame. If an interrupt or an
    error ends a backward pass, its window keeps the forward estimates.
    """

    def __init__(
        self,
        device: Device | NumpyDevice,
        forward: Sequence[RecoveringTracker],
        back: Sequence[RecoveringTracker],
        add: Callable[[int, list[Estimate]], object],
        progress: Callable[[str], object],
        *,
        fps: float = 30.0,
    ) -> None:
        self._device, self._forward, self._back, self._fps = device, forward, back, fps
        self._add, self._progress = add, progress
        self._window, self._n_bytes = list[_WindowFrame](), 0
        self._pool = ThreadPoolExecutor(1)  # crops observations while the device searches

    def step(self, index: int, shown: Observation) -> None:
        """Track the next frame forward, and back from it if the window is full."""
        entry, window = _keep(self._device, shown, self._pool), self._window
        window.append((index, entry, [tracker.step(shown) for tracker in self._forward]))
        self._n_bytes += sum(stored.nbytes for _, stored, _ in window[:-_CROPPING][-1:])
        self._progress("tracking")
        if is_full(len(window), self._n_bytes):
            self._go_back(len(window) - min(OVERLAP, len(window) // 3))
            self._n_bytes = sum(stored.nbytes for _, stored, _ in self._window[:-_CROPPING])

    def finish(self) -> None:
        """Track the last window back."""
        self._go_back(len(self._window))

    def _go_back(self, n_final: int) -> None:
        """Fuse the window; its first `n_final` frames are final."""
        window, report = self._window, partial(self._progress, "tracking back")
        self._window = window[n_final:]
        try:
            final = _fuse_window(self._device, self._back, window, self._fps, report)
        except (KeyboardInterrupt, UserError):
            self._window, n_final = [], len(window)
            final = [list(map(_without_disagreement, of)) for _, _, of in window]
            raise
        finally:
            for (index, _, _), estimates in zip(window[:n_final], final, strict=False):
                self._add(index, estimates)


def is_full(n_frames: int, n_bytes: int) -> bool:
    """Return whether a window of so many frames and bytes is full."""
    return n_frames >= MOST_FRAMES or (n_frames > 2 and n_bytes > MOST_BYTES)


class _Kept(NamedTuple):
    """An observation whose voxels stay valid when the next one is made; cropped ones come from
    another thread."""

    shown: Future[CroppedVoxels] | Shown
    points: PointObservations | None

    @property
    def nbytes(self) -> int:
        return self.shown.result().nbytes if isinstance(self.shown, Future) else 0


def _keep(device: Device | NumpyDevice, observation: Observation, pool: Executor) -> _Kept:
    """Voxels in NumPy, and those carved without maps, are copied, others cropped."""
    shown, points = split_observation(observation)
    if isinstance(shown, Voxels) and (evidence := shown.download_evidence()) is not None:
        pictures = None if shown.frame is None else shown.frame.images
        return _Kept(pool.submit(crop_voxels, shown.cloud(), evidence, pictures), points)
    if isinstance(shown, (Voxels, HostVoxels)):
        return _Kept(store_voxels(device, shown), points)
    return _Kept(shown, points)  # nothing: image features are tracked one way


def _reverse_observations(
    device: Device | NumpyDevice, window: list[_WindowFrame]
) -> Iterator[Observation]:
    """Yield the observations of a window in reverse order; each overwrites the one before."""
    parts = [entry for _, entry, _ in reversed(window)]
    crops = [shown.result() for shown, _ in parts if isinstance(shown, Future)]
    restored = RestoredVoxels(device, crops) if crops and isinstance(device, Device) else None
    for shown, points in parts:
        if isinstance(shown, Future):
            assert restored is not None
            yield with_points(restored.show(shown.result()), points)
        else:
            yield with_points(shown, points)


def _fuse_window(
    device: Device | NumpyDevice,
    back: Sequence[RecoveringTracker],
    window: list[_WindowFrame],
    fps: float,
    progress: Callable[[], object],
) -> list[list[Estimate]]:
    """Run the backward passes over a window; return each track's fused estimates of its frames."""
    if not window:
        return []
    for tracker, last in zip(back, window[-1][2], strict=True):
        tracker.start(last.pose)
    both_passes: list[list[tuple[list[Estimate], np.ndarray]]] = [[] for _ in back]
    for observation, (_, _, forward) in zip(
        _reverse_observations(device, window), reversed(window), strict=True
    ):
        for frames, tracker, ahead in zip(both_passes, back, forward, strict=True):
            passes = [ahead, tracker.step(observation)]
            poses = np.stack([each.pose for each in passes])
            frames.append((passes, tracker.score_poses(poses)))
        progress()
    tracks = []
    for frames in both_passes:
        passes_of, errors = zip(*frames[::-1], strict=True)
        tracks.append(fuse_passes(passes_of, np.stack(errors), fps))
    return [list(estimates) for estimates in zip(*tracks, strict=True)]


def _without_disagreement(estimate: Estimate) -> Estimate:
    """Return an estimate with unknown (NaN) disagreement, because there is no other pass to compare
    with."""
    return replace(estimate, disagreement=np.full(len(limb_ends(estimate.body)), np.nan))


def fuse_passes(
    estimates: Sequence[Sequence[Estimate]],
    errors: np.ndarray,
    fps: float = 30.0,
) -> list[Estimate]:
    """Fuse K passes' estimates of consecutive frames, `fps` per second, into one estimate per
    frame.

    errors: (F, K) of their poses. Trunk and limbs are chosen one by one. The `disagreement` of a
    limb is the distance of its end in the passes from that in the result.
    """
    passes, body = _Passes(estimates), estimates[0][0].body
    of_limb, limbs = limb_joints(body), limb_masks(body)
    trunk = ~np.any(of_limb, axis=0)
    trunk |= ~trunk.any()  # if the body has no joints but those of its limbs
    whole = passes.choose(errors, passes.joints[:, :, trunk])
    agreed = passes.find_agreeing_passes(whole, trunk)
    pose, deviation = (
        average_passes(passes.poses, agreed),
        average_deviations(passes.deviations, agreed),
    )
    for joints, dofs in zip(of_limb, limbs, strict=True):
        chosen = passes.choose(errors, passes.joints[:, :, joints])
        agreed = passes.find_agreeing_passes(chosen, joints)
        angles, places = (average_passes(of, agreed) for of in (passes.poses, passes.joints))
        mixed = np.where(dofs, angles, pose)
        pose[:, dofs] = solve_inverse_kinematics(body, mixed, dofs, joints, places)[:, dofs]
        deviation[:, dofs] = average_deviations(passes.deviations, agreed)[:, dofs]
    known = np.any(~passes.lost, axis=0)
    n_smoothed = round(SMOOTHED_SECONDS * fps) | 1  # odd, as a parabola's window is
    pose = smooth_poses(body, pose, known, n_smoothed)
    apart = passes.measure_disagreement(pose)
    return [
        replace(of[way], pose=pose[row], deviation=deviation[row], disagreement=apart[row])
        if known[row] else _without_disagreement(of[way])
        for row, (way, of) in enumerate(zip(whole, estimates, strict=True))
    ]  # fmt: skip


def smooth_poses(
    body: BodyModel,
    poses: np.ndarray,
    known: np.ndarray,
    n: int,
) -> np.ndarray:
    """Return poses (F, D) smoothed by local parabolas over `n` frames (Savitzky & Golay 1964),
    within the body's limits.

    First smooth the angles; then fit each limb to its smoothed joints by inverse kinematics,
    because different angles can give the same pose. If smoothing would move a joint by more than
    half of `SAME_PLACE`, the limb stays as it was tracked: it jumps to where it was found again.
    Frames that are not `known` (F,) stay as they are, and no parabola crosses them.
    """
    poses, most = unwrap_angles(poses, body), SAME_PLACE / 2
    for run in find_true_runs(known):
        if n < 5 or run.stop - run.start < n:  # a parabola passes through any three points
            continue
        tracked = posed_joints(body, poses[run])
        places = smooth_locally(tracked, n)
        smooth = np.clip(smooth_locally(poses[run], n), body.lower, body.upper)
        off = np.linalg.norm(posed_joints(body, smooth) - tracked, axis=-1).max(1)
        poses[run] = np.where(off[:, None] < most, smooth, poses[run])
        moved = np.linalg.norm(places - tracked, axis=-1)
        for dofs, joints in zip(limb_masks(body), limb_joints(body), strict=True):
            steady = moved[:, joints].max(1, initial=0) < most
            reached = solve_inverse_kinematics(
                body, poses[run], dofs, joints, places, _SMOOTHED_WITHIN
            )
            poses[run] = np.where(steady[:, None], reached, poses[run])
    return poses


class _Passes:
    """Poses and deviations (K, F, D) and joints (K, F, J, 3) m of K passes, and the frames (K, F)
    in which each has lost the person."""

    def __init__(self, estimates: Sequence[Sequence[Estimate]]) -> None:
        self._body = estimates[0][0].body
        passes = list(zip(*estimates, strict=True))
        poses = np.stack([[estimate.pose for estimate in each] for each in passes])
        self.poses = unwrap_angles(poses, self._body)  # from one pass to the other
        self.deviations = np.stack([[estimate.deviation for estimate in each] for each in passes])
        self.lost = np.array([[estimate.lost for estimate in each] for each in passes])
        self.joints = np.stack([posed_joints(self._body, angles) for angles in self.poses])

    def choose(self, misfits: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Return the best pass (F,) by misfits (F, K) and by the jumps of joints between frames;
        places: (K, F, N, 3) m, the joints of each pass."""
        costs = _JUMP_PER_ERROR * misfits
        costs += 1e6 * (self.lost & ~self.lost.all(0)).T
        jumps = np.linalg.norm(places[None, :, 1:] - places[:, None, :-1], axis=-1).mean(-1)
        return find_best_path(costs, np.moveaxis(jumps, -1, 0))

    def find_agreeing_passes(self, way: np.ndarray, compared: np.ndarray) -> np.ndarray:
        """Return which passes (K, F) have the joints `compared` (J,) where the chosen `way` (F,)
        has them.

        It is the chosen pass alone if the average of the poses would put the joints elsewhere.
        """
        alone = np.arange(len(self.poses))[:, None] == way
        chosen = self.joints[way, np.arange(len(way))]
        apart = np.linalg.norm(self.joints - chosen, axis=-1)[..., compared].max(-1)
        agreed = alone | ((apart < SAME_PLACE) & ~self.lost)
        off = posed_joints(self._body, average_passes(self.poses, agreed))
        off -= average_passes(self.joints, agreed)
        between = np.linalg.norm(off, axis=-1)[:, compared].max(-1) < SAME_PLACE / 4
        return np.where(between, agreed, alone)

    def measure_disagreement(self, poses: np.ndarray) -> np.ndarray:
        """Return the distance (F, L), m, of the limbs' ends from those of `poses` (F, D), as
        geometric mean over the passes; NaN in frames that fewer than two passes have tracked."""
        ends = limb_ends(self._body)
        away = self.joints[:, :, ends] - posed_joints(self._body, poses)[:, ends]
        far = np.maximum(np.linalg.norm(away, axis=-1), LEAST_DISTANCE)
        several = (~self.lost).sum(0) > 1
        mean = np.exp(average_passes(np.log(far), ~self.lost | ~several))
        return np.where(several[:, None], mean, np.nan)


def average_passes(values: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """Return the means (F, ...) of values (K, F, ...) over those with `taken` (K, F)."""
    n_taken = taken.sum(0)
    shape = n_taken.shape + (1,) * (values.ndim - 2)
    return np.einsum("kf,kf...->f...", taken, values) / n_taken.reshape(shape)


def average_deviations(deviations: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """Return the deviations (F, D) of means over those with `taken` (K, F), assuming independent
    errors of deviations (K, F, D)."""
    return np.sqrt(average_passes(deviations**2, taken) / taken.sum(0)[:, None])

"""Base classes of all filters: the estimate, and the steps of a frame around the search."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.filters.limb_search import LimbSearch
from apf.filters.particle_set import ParticleSet
from apf.likelihood.base import Likelihood
from apf.likelihood.observations import (
    Observation,
    PointObservations,
    Shown,
    with_points,
)
from apf.scene import Scene
from cl import Array, InputError, Launch, Step
from cl.staging import Download


@dataclass(frozen=True, eq=False)
class Estimate:
    """Result of one frame.

    body: the tracked body, with D degrees of freedom and J joints. pose: (D,) m and rad, the
    weighted mean of the last layer's particles (Song et al. eq. 12), refined. deviation: (D,)
    standard deviation of the particles. ess, beta, least_error: (n_layers,) effective sample size,
    annealing exponent and error of the best particle. information: (D, D) matrix of the
    refinement's linear system, about the inverse covariance of the pose; zero or (0, 0) without
    refinement. candidates: (K, D) poses that the limb search chose from, see `LimbSearch`; K = 1
    without limb search. candidate_errors: (K,) their errors. misfit: misfit of the pose, see
    `VoxelLikelihood.misfit_launcher`; NaN if the likelihood has none. confidence, lost, present,
    restart: set by `apf.tracking.recovery`. disagreement: (L,) m, see `apf.tracking.two_way`; None
    after a single pass.
    """

    body: BodyModel
    pose: np.ndarray
    deviation: np.ndarray
    ess: np.ndarray
    beta: np.ndarray
    least_error: np.ndarray
    information: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    candidates: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    candidate_errors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    misfit: float = float("nan")
    confidence: float = float("nan")
    lost: bool = False
    present: bool = True
    restart: int = 0
    disagreement: np.ndarray | None = None

    @property
    def joints(self) -> np.ndarray:
        """(J, 3) m, the positions of `body.joint_names` in the pose."""
        return posed_joints(self.body, self.pose[None])[0]


class Tracker:
    """Tracker of one body: call `start(pose)` once, then `step(observation)` for each frame, or
    `stream(observations)`."""

    def __init__(self, scene: Scene, config: FilterConfig) -> None:
        self.body, self.config = scene.body, config

    def start(self, pose: np.ndarray) -> None:
        """Put all particles at `pose` (D,). Raises InputError unless it has D finite values."""
        raise NotImplementedError

    def step(
        self, observation: Observation, keypoints: PointObservations | None = None
    ) -> Estimate:
        """Track one frame further and return its estimate.

        observation: voxels, or what else the likelihood observes. keypoints: used if the keypoint
        term has a weight."""
        raise NotImplementedError

    def stream(self, observations: Iterable[Shown]) -> Iterator[Estimate]:
        """Yield the estimate for each of `observations`."""
        return map(self.step, observations)

    def score_poses(self, poses: np.ndarray) -> np.ndarray:
        """Score poses (N, D) against the last observation; return errors (N,) in the likelihood's
        `unit`."""
        raise NotImplementedError


class DeviceTracker(Tracker):
    """Tracker on an OpenCL device.

    The host enqueues a frame without waiting and downloads only the estimates. Subclasses implement
    `_search(source)`, which returns the launches that diffuse and score the particles.
    """

    def __init__(
        self, scene: Scene, likelihood: Likelihood, particles: ParticleSet, config: FilterConfig
    ) -> None:
        super().__init__(scene, config)
        self.device = device = scene.opencl
        self.likelihood = likelihood
        self.particles = particles
        self._limb_search = LimbSearch(device, scene.body, likelihood, config)
        self._misfit = likelihood.misfits
        if self._misfit is None:
            self._misfit = device.to_device(np.full(1, np.nan, np.float32))
        search = self._limb_search
        parts = (particles.result, search.information, search.candidates, search.errors)
        size = sum(part.size for part in parts) + 1
        self._report = device.empty((size,), np.float32)
        self._download = Download(self._report)
        # With an odd number of layers, frames end in alternating sets.
        self._layers = [self._frame_launches(0), self._frame_launches(config.search.n_layers % 2)]
        self._n_frames = 0
        self._streaming: Any = None  # the queue of a search that a stream has begun
        self._judging: dict[int, tuple[Array, Array, list[Launch]]] = {}

    def change_body(self, body: BodyModel) -> None:
        """Track `body` from now on; only its sizes, limits and sigmas may differ.

        Bones, axes and cones must be the same as before. After the next `start` the results are
        bit-equal to those of a new tracker of `body`."""
        self._settle()
        self.body = body
        for part in (self.particles, self.likelihood, self._limb_search):
            part.change_body(body)

    def start(self, pose: np.ndarray) -> None:
        """Put all particles at `pose` (D,). Raises InputError for an impossible one."""
        self._settle()
        self.particles.start(check_pose(self.body, pose))
        self._n_frames = 0
        self.likelihood.forget()

    def step(
        self, observation: Observation, keypoints: PointObservations | None = None
    ) -> Estimate:
        self.observe(with_points(observation, keypoints))
        self.enqueue_search()
        return self.fetch_estimate()()

    def stream(self, observations: Iterable[Observation]) -> Iterator[Estimate]:
        """Yield the estimate for each of `observations`.

        The next observation is fetched while the device searches; on a GPU a second queue also
        prepares it in that time. Fetching may overwrite the previous observation, as
        `Reconstructor.stream` does. When an estimate is yielded, its observation may therefore be
        overwritten, and the search of the next frame has begun: `push` and `widen` take effect one
        frame later, and a stream that the caller stops early has searched one frame more.
        """
        self._settle()
        queue = self.device.new_queue() if self.device.is_gpu else self.device.queue
        under_way: Callable[[], Estimate] | None = None
        for observation in observations:
            (following,) = begin_searches([self], [self.likelihood.prepare(observation)], queue)
            if under_way is not None:
                yield under_way()
            under_way = following
        if under_way is not None:
            yield under_way()

    def observe(self, observation: Observation) -> None:
        """Enqueue the likelihood's preparation of a frame: the first half of `step`."""
        self._settle()
        self.likelihood.observe(observation)

    def enqueue_search(self, queue: Any = None) -> None:
        """Enqueue the search in what was observed. queue: that is enqueued on, if it is not the
        device's own."""
        for step in self._layers[self._n_frames % 2]:
            step()
        self._n_frames += 1
        if queue is not None:
            self._streaming = queue

    def fetch_estimate(self) -> Callable[[], Estimate]:
        """Enqueue the download of the estimate; return a function that waits for it and returns
        it."""
        report, n_layers = self._download.fetch(), self.particles.config.n_layers
        return lambda: unpack_report(report(), self.body, n_layers)

    def score_poses(self, poses: np.ndarray) -> np.ndarray:
        self._settle()
        n = len(poses)
        if n not in self._judging:
            buffer = self.device.empty(poses.shape, np.float32, "poses to judge")
            errors = self.device.empty((n,), np.float32)
            launches = self.likelihood.rescoring_launcher(buffer, errors)
            self._judging[n] = buffer, errors, launches
        buffer, errors, launches = self._judging[n]
        buffer.set(poses.astype(np.float32))
        for launch in launches:
            launch()
        return errors.get() / self.likelihood.unit

    def widen(self, factor: float) -> None:
        """Spread the next frames' particles by `factor` times the noise of the config."""
        self.particles.widen(factor)

    def push(self, offset: np.ndarray) -> None:
        """Shift the next frame's start poses by `offset` (D,), a known part of the motion."""
        self._settle()
        self.particles.push(offset)

    def _settle(self) -> None:
        """Make later commands wait for the search that a stream has begun: the caller may have
        stopped the stream early."""
        if self._streaming is not None:
            self.device.wait_for(self._streaming)
            self._streaming = None

    def _frame_launches(self, source: int) -> list[Step]:
        """Return the launches of a frame that starts from the particles in set `source`."""
        particles, limb_search, likelihood = self.particles, self._limb_search, self.likelihood
        assert self._misfit is not None
        frame, result = particles.frame, particles.result
        search, learning = self._search(source), likelihood.learning_launcher(result)
        if limb_search.writes_misfit:
            end = particles.frame_end(self._report)
            return [
                *search,
                *limb_search.launcher(frame, result, end),
                *learning,
            ]
        return [
            *search,
            *limb_search.launcher(frame, result),
            *likelihood.misfit_launcher(result),
            *learning,
            particles.end_frame(
                limb_search.shift, limb_search.information, limb_search.candidates,
                limb_search.errors, self._misfit, self._report,
            ),
        ]  # fmt: skip

    def _search(self, source: int) -> Sequence[Step]:
        raise NotImplementedError


def begin_searches(
    trackers: Sequence[DeviceTracker], shows: Sequence[Step], queue: Any
) -> list[Callable[[], Estimate]]:
    """Enqueue on `queue` the searches of the trackers of one device in the frame that each one's
    `likelihood.prepare` prepared and `shows` show; return, for each tracker, a function that waits
    for its search and returns the estimate."""
    device = trackers[0].device
    with device.enqueue_on(queue) as commands:
        for show in shows:
            show()
        device.make_wait(commands)  # the next observations overwrite these
        for tracker in trackers:
            tracker.enqueue_search(queue)
        return [tracker.fetch_estimate() for tracker in trackers]


def check_pose(body: BodyModel, pose: np.ndarray) -> np.ndarray:
    """Return `pose` as (D,) float64 within the limits of `body`; InputError if it cannot be one."""
    pose = np.asarray(pose, np.float64)
    if pose.shape != (body.n_dof,) or not np.isfinite(pose).all():
        raise InputError(
            f"the initial pose has shape {pose.shape}; expected {body.n_dof} finite values "
            f"for the body {body.name}"
        )
    return np.clip(pose, body.lower, body.upper)


@cache
def _symmetric_indices(n: int) -> np.ndarray:
    """Return (n, n) indices that expand a packed lower triangle, row by row, to a symmetric
    matrix."""
    indices = np.zeros((n, n), np.intp)
    indices[np.tril_indices(n)] = np.arange(n * (n + 1) // 2)
    return np.maximum(indices, indices.T)


def unpack_report(report: np.ndarray, body: BodyModel, n_layers: int) -> Estimate:
    """Return the Estimate from the downloaded `report`.

    The report holds `ParticleSet.result` of `n_layers` layers, the lower triangle of
    `Estimate.information` row by row, candidates, their errors, and the misfit."""
    report, n_dof = report.astype(np.float64), body.n_dof
    n_information = n_dof * (n_dof + 1) // 2
    n_candidates = (report.size - 2 * n_dof - 3 * n_layers - n_information - 1) // (n_dof + 1)
    sizes = (n_dof, n_dof, 3 * n_layers, n_information, n_candidates * n_dof, n_candidates)
    pose, deviation, layers, packed, candidates, errors, misfit = np.split(report, np.cumsum(sizes))
    ess, beta, error = layers.reshape(n_layers, 3).T
    information = packed[_symmetric_indices(n_dof)]
    chosen_from = candidates.reshape(n_candidates, n_dof), errors
    estimate = (pose, deviation, ess, beta, error, information)
    return Estimate(body, *estimate, *chosen_from, float(misfit[0]))

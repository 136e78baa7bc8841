"""The annealed particle filter over voxels (Song et al. 2.3; Deutscher & Reid 2005)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.filters.limb_search import Alternatives
from apf.filters.particle_set import ParticleSet
from apf.likelihood.base import Scorer
from apf.likelihood.voxel import VoxelLikelihood
from apf.scene import Scene
from cl import Array, InputError, Launch


@dataclass(frozen=True, eq=False)
class Estimate:
    """One frame's result.

    pose: (D,) weighted mean of the last layer's particles, refined. deviation: (D,) their standard
    deviation.
    ess, beta, least_error: (n_layers,) effective sample size, exponent, error of the best particle.
    information: (D, D) of the refinement's linear system, about the inverse of the pose's
    covariance; zero or (0, 0) where nothing was refined. misfit: of the pose, see
    `VoxelLikelihood.misfit_launcher`; NaN of a scorer that knows none. confidence, lost, restart:
    see `apf.tracking.recovery`, which fills them in.
    """

    pose: np.ndarray
    deviation: np.ndarray
    ess: np.ndarray
    beta: np.ndarray
    least_error: np.ndarray
    information: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    misfit: float = float("nan")
    confidence: float = float("nan")
    lost: bool = False
    restart: int = 0


class Tracker:
    """What all searches share: a particle set that a scorer judges, several times per frame.

    `start(pose)` once, then `step(observation)` per frame, or `stream(observations)`. A frame is
    enqueued without waiting for the host; only the estimate comes back.
    """

    def __init__(
        self, scene: Scene, scorer: Scorer, particles: ParticleSet, config: FilterConfig
    ) -> None:
        self.device = device = scene.opencl
        self.body = body = scene.body
        self.config = config
        self.scorer = scorer
        self._particles = particles
        self._alternatives = Alternatives(device, body, scorer, config, particles.seeds)
        unknown = device.to_device(np.full(particles.n_runs, np.nan, np.float32))
        self._misfit: Array = getattr(scorer, "misfit", unknown)
        size = particles.result.size + self._alternatives.information.size + particles.n_runs
        self._report = device.empty((size,), np.float32)
        # With an odd number of layers, frames end in alternating sets.
        self._layers = [self._frame_launches(0), self._frame_launches(config.n_layers % 2)]
        self._n_frames = 0

    def start(self, pose: np.ndarray) -> None:
        """Put all particles of all runs at `pose` (D,)."""
        self._particles.start(checked_pose(self.body, pose))
        self._n_frames = 0
        if hasattr(self.scorer, "forget"):
            self.scorer.forget()

    def restart(self, run: int, pose: np.ndarray) -> None:
        """Put all particles of one run at `pose` (D,), while the others go on."""
        self._particles.restart(run, checked_pose(self.body, pose))

    def step(self, observation: Any) -> Estimate:
        """Track one frame further, Voxels or what else the scorer observes: the first run's
        estimate."""
        return self.step_runs(observation)[0]

    def step_runs(self, observation: Any) -> list[Estimate]:
        """Track one frame further: the estimate of each run."""
        self.observe(observation)
        return self.search_runs()

    def stream(self, observations: Iterable[Any]) -> Iterator[Estimate]:
        """The first run's estimate for each of `observations`, of which the next one is taken while
        the device searches; on a GPU it is made in that time, too, by another queue.

        Taking it may overwrite the one before, as `Reconstructor.stream` does: when an estimate is
        given, its observation may be gone.
        """
        return (estimates[0] for estimates in self.stream_runs(observations))

    def stream_runs(self, observations: Iterable[Any]) -> Iterator[list[Estimate]]:
        """As `stream`, the estimates of each run."""
        queue = self.device.new_queue() if self.device.is_gpu else self.device.queue
        under_way: Callable[[], list[Estimate]] | None = None
        for observation in observations:
            self.device.wait_for(queue)
            self.observe(observation)
            if under_way is not None:
                yield under_way()
            with self.device.on(queue):
                under_way = self._begin_search()
        if under_way is not None:
            yield under_way()

    def observe(self, observation: Any) -> None:
        """Enqueue what the scorer keeps of an observation, the first half of `step`."""
        self.scorer.observe(observation)

    def search(self) -> Estimate:
        """The estimate for what was observed, the second half of `step`."""
        return self.search_runs()[0]

    def search_runs(self) -> list[Estimate]:
        """Each run's estimate for what was observed, the second half of `step_runs`."""
        return self._begin_search()()

    def widen(self, factor: float) -> None:
        """Spread the next frames' particles by `factor` times the noise of the config."""
        self._particles.widen(factor)

    def _begin_search(self) -> Callable[[], list[Estimate]]:
        """Enqueue the search; what is returned waits for it and gives each run's estimate."""
        for launch in self._layers[self._n_frames % 2]:
            launch()
        self._n_frames += 1
        report = self._report.fetch()
        return lambda: unpacked(report(), self.body.n_dof, self._particles.n_runs)

    def push(self, offset: np.ndarray) -> None:
        """Search the next frame from poses moved by `offset` (D,): what is known of the motion."""
        self._particles.push(offset)

    def _frame_launches(self, source: int) -> list[Launch]:
        """A frame that starts from the particles in set `source`."""
        particles, result = self._particles, self._particles.result
        launches = self._search(source)
        alternatives = self._alternatives
        launches += alternatives.launcher(particles.frame, result)
        if hasattr(self.scorer, "misfit_launcher"):
            launches += self.scorer.misfit_launcher(result)
        if hasattr(self.scorer, "learner"):
            launches += self.scorer.learner(result)
        told = (alternatives.information, self._misfit, self._report)
        return [*launches, particles.settle(alternatives.shift, *told)]

    def _search(self, source: int) -> list[Launch]:
        raise NotImplementedError


class AnnealedParticleFilter(Tracker):
    """Tracks the body of a scene through its voxels. Twin: reference/annealed.py.

    With a `scorer` of its own it tracks through whatever that observes, image features say, and
    the scene needs no grid. With several `seeds` it makes as many runs at once, each bit by bit
    that of its seed alone, for `step_runs`; a scorer of its own then has room for the particles of
    all.
    """

    def __init__(
        self,
        scene: Scene,
        config: FilterConfig | None = None,
        *,
        scorer: Scorer | None = None,
        seeds: Sequence[int] | None = None,
    ) -> None:
        config = config or FilterConfig()
        if scorer is None:
            scorer = VoxelLikelihood(scene, config, len(seeds or [0]))
        particles = ParticleSet(scene.opencl, scene.body, config, seeds)
        super().__init__(scene, scorer, particles, config)

    def _search(self, source: int) -> list[Launch]:
        launches = [self._particles.diffuse(0, source)]
        for layer in range(self.config.n_layers):
            source = 1 - source
            launches += self.scorer.launcher(self._particles.sets[source])
            launches += self._particles.renew(layer, self.scorer.errors, source)
        return launches


def checked_pose(body: BodyModel, pose: np.ndarray) -> np.ndarray:
    """`pose` as (D,) float64 within the limits of `body`; InputError if it cannot be one."""
    pose = np.asarray(pose, np.float64)
    if pose.shape != (body.n_dof,) or not np.isfinite(pose).all():
        raise InputError(
            f"the initial pose has shape {pose.shape}; expected {body.n_dof} finite values "
            f"for the body {body.name}"
        )
    return np.clip(pose, body.lower, body.upper)


@cache
def _symmetric_places(n: int) -> np.ndarray:
    """(n, n) where each element of a symmetric matrix stands in its lower triangle, row by row."""
    places = np.zeros((n, n), np.intp)
    places[np.tril_indices(n)] = np.arange(n * (n + 1) // 2)
    return np.maximum(places, places.T)


def unpacked(report: np.ndarray, n_dof: int, n_runs: int) -> list[Estimate]:
    """What a tracker downloads, as each run's Estimate: `ParticleSet.result`, the lower triangle of
    `Estimate.information` row by row for every run, the misfits."""
    report = report.astype(np.float64)
    n_poses, n_triangles = n_runs * n_dof, n_runs * n_dof * (n_dof + 1) // 2
    poses, deviations = report[: 2 * n_poses].reshape(2, n_runs, n_dof)
    layers = report[2 * n_poses : -n_triangles - n_runs].reshape(-1, n_runs, 3)
    triangles = report[-n_triangles - n_runs : -n_runs].reshape(n_runs, -1)
    information, misfits = triangles[:, _symmetric_places(n_dof)], report[-n_runs:]
    estimates = []
    for run in range(n_runs):
        ess, beta, error = layers[:, run].T
        told = (poses[run], deviations[run], ess, beta, error, information[run])
        estimates.append(Estimate(*told, float(misfits[run])))
    return estimates

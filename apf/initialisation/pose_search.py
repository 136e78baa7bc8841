"""The global search in one frame: position, heading, size and pose of a person."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from apf.backend import make_filter
from apf.body.limbs import swinging_bones
from apf.body.model import BodyModel
from apf.body.stature import stature
from apf.filters.base import DeviceTracker, Tracker
from apf.filters.config import FilterConfig
from apf.initialisation.config import StartConfig
from apf.initialisation.hypotheses import (
    Hypothesis,
    registration_error,
    search_body,
    select_close,
    select_distinct,
    standing_pose,
    walking_factor,
)
from apf.initialisation.shape_fit import Cloud, fit_shape
from apf.initialisation.shape_model import ShapeModel
from apf.likelihood.observations import AnyVoxels
from apf.scene import Scene


@dataclass(frozen=True, eq=False)
class SearchTask:
    """Prior knowledge for the search. height: known stature, m. keep_shape: the scene's body is the
    person's own. seed: of all random numbers. way: (2,) m, displacement of the person over the
    first frames."""

    height: float | None
    keep_shape: bool
    seed: int
    way: np.ndarray


class PoseSearch:
    """Search of single frames for a person of unknown size and pose: `search(voxels, cloud)`. The
    template is the scene's body."""

    def __init__(self, scene: Scene, task: SearchTask, config: StartConfig) -> None:
        self.scene, self.task, self.config, self.template = scene, task, config, scene.body
        self.model = ShapeModel(self.template, config.shape.prior)
        self.free = () if task.keep_shape else (0, 1)
        self.random = np.random.default_rng(task.seed)
        self.trackers = Trackers(scene)
        search = config.search
        self._near_config = config.filter.with_changes(
            n_particles=search.n_particles_near, noise=search.near_noise, trunk_layers=0,
            limb_search_reach=0.0, seed=task.seed,
        )  # fmt: skip
        self._near: tuple[np.ndarray, BodyModel] | None = None  # the last shape and its body

    def __call__(self, voxels: AnyVoxels, cloud: Cloud) -> list[Hypothesis]:
        """Return the best hypotheses with different headings, best first.

        voxels: the observation for a tracker. cloud: the person's points in them.
        """
        headings = self.config.headings
        shape = np.zeros(len(self.model.deviation))
        low, high = cloud.heights
        if self.free:
            shape[0] = np.log((self.task.height or high - low) / stature(self.template))
        body = self.model.body(shape)
        loose = search_body(body, spread=self.config.spread)
        tracker = self._searcher(loose, self.config.search.n_particles_body)
        found = []
        for heading in np.arange(headings.n_headings) * 2 * np.pi / headings.n_headings:
            start = standing_pose(body, cloud, heading, self.config.search)
            pose, error = _run_search(tracker, start, voxels)
            found.append(self._hypothesis(shape, pose, error, body, cloud))
        kept = [
            self._fit_size(voxels, cloud, hypothesis)
            for hypothesis in self.close(self.distinct(found, headings.n_kept + 1))
        ]
        return self.distinct([self._penalise_backwards(h) for h in kept], headings.n_kept)

    def search_limbs(self, voxels: AnyVoxels, cloud: Cloud, hypothesis: Hypothesis) -> Hypothesis:
        """Search again for one limb after the other, anywhere within its limits."""
        body = self.model.body(hypothesis.shape)
        best = self.search_near(voxels, cloud, hypothesis.shape, hypothesis.pose)
        for limb in swinging_bones(body):
            loose = search_body(body, limb, self.config.spread)
            # The tracker's own limb search would try the same starts.
            tracker = self._searcher(
                loose, self.config.search.n_particles_limb, limb_search_reach=0.0
            )
            found = [
                self.search_near(voxels, cloud, best.shape, _run_search(tracker, start, voxels)[0])
                for start in self._limb_starts(best.pose, loose.sigma > 0)
            ]
            # A limb in the air costs little in the images; the voxels show better where it is.
            best = min([best, *found], key=lambda h: h.cost * h.registration_error)
        return self._fit_size(voxels, cloud, best)

    def search_near(
        self, voxels: AnyVoxels, cloud: Cloud, shape: np.ndarray, pose: np.ndarray
    ) -> Hypothesis:
        """Return the best hypothesis with this shape near this pose."""
        if self._near is None or np.any(self._near[0] != shape):
            self._near = shape, self.model.body(shape)
        tracker = self.trackers(self._near[1], self._near_config)
        pose, error = _run_search(tracker, pose, voxels)
        return self._hypothesis(shape, pose, error, tracker.body, cloud)

    def close(self, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
        """Return the hypotheses that are nearly as good as the best."""
        return select_close(hypotheses, self.config.headings.max_cost_ratio)

    def distinct(self, hypotheses: list[Hypothesis], n: int) -> list[Hypothesis]:
        """Return the best `n` hypotheses with different headings, best first."""
        return select_distinct(self.template, hypotheses, n, self.config.headings.separation)

    def walking_factor(self, body: BodyModel, poses: np.ndarray) -> float:
        """Return the cost factor of poses (M, D), see `hypotheses.walking_factor`."""
        return walking_factor(body, poses, self.task.way, self.config.headings)

    def _hypothesis(
        self, shape: np.ndarray, pose: np.ndarray, error: float, body: BodyModel, cloud: Cloud
    ) -> Hypothesis:
        registration = registration_error(body, pose, cloud, self.config.cost, self.config.shape)
        return Hypothesis(
            shape, pose, error, registration, self.config.cost.combine(error, registration)
        )

    def _penalise_backwards(self, found: Hypothesis) -> Hypothesis:
        """Return the hypothesis with a higher error if the person moves backwards."""
        error = found.error * self.walking_factor(self.template, found.pose[None])
        cost = self.config.cost.combine(error, found.registration_error)
        return replace(found, error=error, cost=cost)

    def _fit_size(self, voxels: AnyVoxels, cloud: Cloud, hypothesis: Hypothesis) -> Hypothesis:
        """Fit size and girth to the cloud; return the hypothesis with them if that lowers its
        cost."""
        shape, poses = fit_shape(
            self.template, [cloud], hypothesis.shape, hypothesis.pose[None], self.task.height,
            config=self.config.shape, n_steps=self.config.search.n_size_steps, free=self.free,
        )  # fmt: skip
        other = self.search_near(voxels, cloud, shape, poses[0])
        return min(hypothesis, other, key=lambda h: h.cost)

    def _searcher(self, body: BodyModel, n_particles: int, **settings: float) -> Tracker:
        search = self.config.search
        config = self.config.filter.with_changes(
            n_particles=n_particles, noise=search.noise, noise_decay=search.noise_decay,
            trunk_layers=0, seed=self.task.seed, **settings,
        )  # fmt: skip
        return self.trackers(body, config)

    def _limb_starts(self, pose: np.ndarray, moving: np.ndarray) -> list[np.ndarray]:
        """Return start poses whose `moving` part is unchanged, at rest, and random, halfway between
        rest and a uniform sample within its limits."""
        rest = self.template.rest_pose
        low, high = self.template.lower[moving], self.template.upper[moving]
        low = np.where(np.isfinite(low), low, -np.pi)
        high = np.where(np.isfinite(high), high, np.pi)
        starts = [pose, np.where(moving, rest, pose)]
        while len(starts) < self.config.search.n_limb_starts:
            anywhere = self.random.uniform(low, high)
            start = pose.copy()
            start[moving] = (rest[moving] + anywhere) / 2
            starts.append(start)
        return starts


class Trackers:
    """`trackers(body, config)`: returns a tracker with these settings for a body of the template's
    structure.

    A start tries about fifty bodies, and making a tracker takes as long as several of its steps. So
    there is one tracker for each set of settings, and it is given the next body. A tracker is valid
    until the next call with the same settings; call its `start` first.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._kept: dict[FilterConfig, DeviceTracker] = {}

    def __call__(self, body: BodyModel, config: FilterConfig) -> Tracker:
        """Return the tracker of `body` with the settings `config`."""
        kept = self._kept.get(config)
        if kept is not None:
            if kept.body is not body:
                kept.change_body(body)
            return kept
        tracker = make_filter(replace(self._scene, body=body), config)
        if isinstance(tracker, DeviceTracker):  # making a NumPy twin takes no time
            self._kept[config] = tracker
        return tracker


def _run_search(tracker: Tracker, start: np.ndarray, voxels: AnyVoxels) -> tuple[np.ndarray, float]:
    """Return the pose (D,) that `tracker` finds from `start`, and the error of the best
    particle."""
    tracker.start(start)
    estimate = tracker.step(voxels)
    return estimate.pose, float(estimate.least_error[-1])

"""Base class of the NumPy searches. Twin of apf/filters/base.py."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from apf.filters.base import Estimate, Tracker, check_pose
from apf.filters.config import FilterConfig
from apf.filters.particle_set import layer_sigmas, velocity_memory
from apf.likelihood.observations import Observation, PointObservations, with_points
from apf.reference.filters.limb_search import LimbSearchResult, search_limbs
from apf.reference.filters.noise import normals
from apf.reference.likelihood.base import NumpyLikelihood
from apf.scene import Scene


class NumpyTracker(Tracker):
    """Base class of the NumPy searches. Subclasses implement `_search()`."""

    def __init__(self, scene: Scene, likelihood: NumpyLikelihood, config: FilterConfig) -> None:
        super().__init__(scene, config)
        self.likelihood = likelihood

    def start(self, pose: np.ndarray) -> None:
        n = self.config.search.n_particles
        self.poses = np.tile(check_pose(self.body, pose), (n, 1))
        self._parents = np.arange(n)
        self._frame = 0
        self._last, self._drift, self._velocity, self._deviation = np.zeros((4, self.body.n_dof))
        self.likelihood.forget()

    def step(
        self, observation: Observation, keypoints: PointObservations | None = None
    ) -> Estimate:
        """Track one frame further."""
        likelihood = self.likelihood
        likelihood.observe(with_points(observation, keypoints))
        estimate = self._search()
        n_dof = self.body.n_dof
        ended = LimbSearchResult(
            estimate.pose, np.zeros((n_dof, n_dof)), estimate.pose[None], np.zeros(1)
        )
        if likelihood.points is not None or likelihood.observed is not None:
            frame = self._frame + 1
            ended = search_limbs(self.body, likelihood, estimate.pose, self.config, frame)
        pose = ended.pose
        # The first frame's change is the start's error, not a motion.
        change = pose - self._last if self._frame > 0 else np.zeros(self.body.n_dof)
        self._velocity *= velocity_memory(self.body, self.config.search)
        self._velocity += self.config.search.velocity * change
        self._last, self._drift = pose, pose - estimate.pose + self._velocity
        self._frame += 1
        misfit = likelihood.misfit(pose)
        likelihood.learn(pose)
        return replace(
            estimate, pose=pose, information=ended.information, candidates=ended.candidates,
            candidate_errors=ended.errors, misfit=misfit,
        )  # fmt: skip

    def score_poses(self, poses: np.ndarray) -> np.ndarray:
        return self.likelihood.rescore(poses, 1) / self.likelihood.unit

    def _search(self) -> Estimate:
        """Return the estimate of a frame that was observed, before its refinement."""
        raise NotImplementedError

    def _noise(self, layer: int) -> np.ndarray:
        """Return the changes (N, D) that a layer adds to the particles: noise, and the motion in
        the first layer."""
        config = self.config.search
        shape = (config.n_particles, self.body.n_dof)
        deviation = config.layer_noise[layer] * layer_sigmas(self.body, config)[layer]
        noise = deviation * normals(config.seed, self._frame, layer, *shape)
        return noise + self._drift if layer == 0 else noise

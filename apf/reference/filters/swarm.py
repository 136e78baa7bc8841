"""The particle swarm in NumPy. Twin of apf/filters/swarm.py and swarm.cl."""

from __future__ import annotations

import numpy as np

from apf.body.model import BodyModel
from apf.filters.base import Estimate
from apf.filters.config import FilterConfig
from apf.filters.searches import SwarmConfig
from apf.reference.filters.annealing import diffuse
from apf.reference.filters.base import NumpyTracker
from apf.reference.filters.noise import draw_words, uniform01
from apf.reference.likelihood.base import NumpyLikelihood
from apf.scene import Scene


def uniform_pairs(seed: int, frame: int, iteration: int, shape: tuple[int, int]) -> np.ndarray:
    """Return (N, D, 2) r1 and r2 of Rymut 2016 eq. (2.27), for every particle and degree of
    freedom."""
    return uniform01(draw_words(seed, frame, iteration, *shape)[..., :2])


class NumpyParticleSwarm(NumpyTracker):
    """Rymut 2016 eq. (2.27)-(2.31); same signature as ParticleSwarm, with a twin as likelihood."""

    def __init__(
        self,
        scene: Scene,
        likelihood: NumpyLikelihood,
        config: FilterConfig,
        swarm: SwarmConfig | None = None,
    ) -> None:
        super().__init__(scene, likelihood, config.with_changes(trunk_layers=0))
        self.swarm = swarm or SwarmConfig()

    def _search(self) -> Estimate:
        config, body, swarm = self.config.search, self.body, self.swarm
        poses = diffuse(self.poses, self._parents, self._noise(0), body.lower, body.upper)
        velocities = np.zeros_like(poses)
        bests, best_errors = poses.copy(), np.full(len(poses), np.inf)
        best, history = 0, []
        for iteration in range(config.n_layers):
            if iteration:
                r1, r2 = np.moveaxis(
                    uniform_pairs(config.seed, self._frame, iteration, poses.shape), -1, 0
                )
                velocities *= swarm.inertia
                velocities += swarm.cognitive * r1 * (bests - poses)
                velocities += swarm.social * r2 * (bests[best] - poses)
                poses, velocities = stop_at_limits(body, poses + velocities, velocities)
            self.likelihood.turn = iteration + self._frame % 2 * config.n_layers
            errors = self.likelihood(poses)
            better = errors < best_errors
            bests[better], best_errors[better] = poses[better], errors[better]
            best = int(np.argmin(best_errors))
            history.append((better.sum(), 0.0, best_errors[best]))
        self.poses, self._parents = bests, np.full(len(poses), best)
        improved, beta, least_error = np.array(history).T
        deviation = np.sqrt(np.mean((bests - bests[best]) ** 2, axis=0))
        return Estimate(self.body, bests[best], deviation, improved, beta, least_error)


def stop_at_limits(
    body: BodyModel, poses: np.ndarray, velocities: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return poses (N, D) within the limits, and velocities that are 0 where one was reached."""
    inside = np.clip(poses, body.lower, body.upper)
    return inside, np.where(inside == poses, velocities, 0.0)

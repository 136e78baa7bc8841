"""The annealed particle filter in NumPy. Twin of apf/filters/annealed.py."""

from __future__ import annotations

import numpy as np

from apf.filters.base import Estimate
from apf.filters.config import FilterConfig
from apf.filters.method import Method
from apf.filters.searches import SirConfig
from apf.filters.sir import check_layers
from apf.reference.filters.annealing import (
    annealing_exponent,
    diffuse,
    effective_size,
    moments,
    normalised_weights,
    systematic_parents,
)
from apf.reference.filters.base import NumpyTracker
from apf.reference.filters.noise import uniform
from apf.reference.image_objective.objective import NumpyImageObjective
from apf.reference.likelihood.base import NumpyLikelihood
from apf.reference.likelihood.keypoints import NumpyKeypointLikelihood
from apf.reference.likelihood.voxel import NumpyVoxelLikelihood
from apf.scene import Scene


def _with_keypoints(
    scene: Scene, config: FilterConfig, base: NumpyLikelihood | None
) -> NumpyLikelihood:
    """Return the likelihood `base` with the keypoints' term if that has a weight, or the
    keypoints' alone."""
    if base is not None and config.keypoints.weight == 0:
        return base
    posture = config.likelihood.posture_prior_weight
    return NumpyKeypointLikelihood(scene, config.keypoints, posture, base)


class NumpyAnnealedParticleFilter(NumpyTracker):
    """Song et al. eq. (10)-(13), step by step; same signature as AnnealedParticleFilter."""

    def __init__(
        self,
        scene: Scene,
        config: FilterConfig | None = None,
        *,
        likelihood: NumpyLikelihood | None = None,
    ) -> None:
        config = config or FilterConfig()
        if likelihood is None:
            voxels = NumpyVoxelLikelihood(scene, config.likelihood)
            likelihood = _with_keypoints(scene, config, voxels)
        super().__init__(scene, likelihood, config)

    def _search(self) -> Estimate:
        config, body = self.config.search, self.body
        history = []
        for layer in range(config.n_layers):
            self.poses = diffuse(
                self.poses, self._parents, self._noise(layer), body.lower, body.upper
            )
            # Launchers are made for two frames, which may end in different particle sets.
            self.likelihood.turn = layer + self._frame % 2 * config.n_layers
            errors = self._score(self.poses)
            beta = self._find_exponent(errors, config.survival_rates[layer])
            weights = normalised_weights(errors, beta)
            mean, self._deviation = moments(self.poses, weights)
            self._parents = systematic_parents(weights, uniform(config.seed, self._frame, layer))
            history.append((effective_size(errors, beta), beta, errors.min()))
        ess, beta, least_error = np.array(history).T
        return Estimate(self.body, mean, self._deviation, ess, beta, least_error)

    def _score(self, poses: np.ndarray) -> np.ndarray:
        return self.likelihood(poses)

    def _find_exponent(self, errors: np.ndarray, survival_rate: float) -> float:
        return annealing_exponent(errors, survival_rate)


def build_voxel_objective(scene: Scene, method: Method) -> NumpyLikelihood:
    """Return the voxels' likelihood of `method`, with the keypoints' if that has a weight."""
    voxels = NumpyVoxelLikelihood(scene, method.filter.likelihood)
    return _with_keypoints(scene, method.filter, voxels)


def build_keypoint_objective(scene: Scene, method: Method) -> NumpyLikelihood:
    """Return the keypoints' likelihood of `method` alone."""
    return _with_keypoints(scene, method.filter, None)


def build_image_objective(scene: Scene, method: Method) -> NumpyLikelihood:
    """Return the image objective of `method`, with the keypoints' if that has a weight."""
    base = NumpyImageObjective(scene, method.filter.search.n_particles, method.image)
    return _with_keypoints(scene, method.filter, base)


class NumpySirParticleFilter(NumpyAnnealedParticleFilter):
    """Rymut 2016 algorithms 1 and 2; same signature as SirParticleFilter."""

    def __init__(
        self,
        scene: Scene,
        likelihood: NumpyLikelihood,
        config: FilterConfig,
        sir: SirConfig | None = None,
    ) -> None:
        check_layers(config)
        super().__init__(scene, config, likelihood=likelihood)
        self.sir = sir or SirConfig()

    def _score(self, poses: np.ndarray) -> np.ndarray:
        return super()._score(poses) ** 2

    def _find_exponent(self, errors: np.ndarray, survival_rate: float) -> float:
        return self.sir.beta or super()._find_exponent(errors, survival_rate)

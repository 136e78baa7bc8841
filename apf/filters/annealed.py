"""The annealed particle filter over voxels (Song et al. 2.3; Deutscher & Reid 2005)."""

from __future__ import annotations

from apf.filters.base import DeviceTracker
from apf.filters.config import FilterConfig
from apf.filters.method import Method
from apf.filters.particle_set import ParticleSet
from apf.image_objective.objective import ImageObjective
from apf.image_objective.opengl.objective import OpenGLObjective
from apf.likelihood.base import Likelihood
from apf.likelihood.keypoints import KeypointLikelihood
from apf.likelihood.voxel import VoxelLikelihood
from apf.scene import Scene
from cl import Step


def make_voxel_likelihood(scene: Scene, config: FilterConfig) -> Likelihood:
    """Return the voxel likelihood; include the keypoint term if its weight is not 0."""
    voxels = VoxelLikelihood(scene, config.likelihood, config.search.n_particles)
    return add_keypoint_term(scene, config, voxels)


def add_keypoint_term(scene: Scene, config: FilterConfig, base: Likelihood | None) -> Likelihood:
    """Add the keypoint term to the likelihood `base` if the term's weight is not 0.

    If `base` is None, return the likelihood of the keypoints alone."""
    if base is not None and config.keypoints.weight == 0:
        return base
    posture, n = config.likelihood.posture_prior_weight, config.search.n_particles
    return KeypointLikelihood(scene, config.keypoints, posture, n, base)


class AnnealedParticleFilter(DeviceTracker):
    """Annealed particle filter that tracks a body by its voxels.

    If a `likelihood` is given, the filter tracks by what that observes, for example image features,
    and the scene needs no grid. Twin: reference/filters/annealed.py.
    """

    def __init__(
        self,
        scene: Scene,
        config: FilterConfig | None = None,
        *,
        likelihood: Likelihood | None = None,
    ) -> None:
        config = config or FilterConfig()
        if likelihood is None:
            likelihood = make_voxel_likelihood(scene, config)
        particles = ParticleSet(scene.opencl, scene.body, config.search)
        super().__init__(scene, likelihood, particles, config)

    def _search(self, source: int) -> list[Step]:
        launches: list[Step] = [self.particles.diffuse(0, source)]
        for layer in range(self.config.search.n_layers):
            source = 1 - source
            launches += self.likelihood.launcher(self.particles.sets[source])
            launches += self.particles.renew(layer, self.likelihood.errors, source)
        return launches


def build_voxel_objective(scene: Scene, method: Method) -> Likelihood:
    """Return the voxels' likelihood of `method`, with the keypoints' if that has a weight."""
    return make_voxel_likelihood(scene, method.filter)


def build_keypoint_objective(scene: Scene, method: Method) -> Likelihood:
    """Return the keypoints' likelihood of `method` alone."""
    return add_keypoint_term(scene, method.filter, None)


def build_image_objective(scene: Scene, method: Method) -> Likelihood:
    """Return the image objective of `method`, with the keypoints' if that has a weight."""
    objective = OpenGLObjective if method.image.renderer == "opengl" else ImageObjective
    base = objective(scene, method.filter.search.n_particles, method.image)
    return add_keypoint_term(scene, method.filter, base)

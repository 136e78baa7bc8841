"""The likelihood of each objective, on a device."""

from __future__ import annotations

from apf.filters.annealed import add_keypoint_term, make_voxel_likelihood
from apf.filters.method import Method
from apf.image_objective.objective import ImageObjective
from apf.image_objective.opengl.objective import OpenGLObjective
from apf.likelihood.base import Likelihood
from apf.scene import Scene


def build_voxel_objective(scene: Scene, method: Method, n_runs: int) -> Likelihood:
    """Return the voxels' likelihood of `method`, with the keypoints' if that has a weight."""
    return make_voxel_likelihood(scene, method.filter, n_runs)


def build_keypoint_objective(scene: Scene, method: Method, n_runs: int) -> Likelihood:
    """Return the keypoints' likelihood of `method` alone."""
    return add_keypoint_term(scene, method.filter, None, n_runs)


def build_image_objective(scene: Scene, method: Method, n_runs: int) -> Likelihood:
    """Return the image objective of `method`, with the keypoints' if that has a weight."""
    objective = OpenGLObjective if method.image.renderer == "opengl" else ImageObjective
    base = objective(scene, method.filter.search.n_particles, method.image)
    return add_keypoint_term(scene, method.filter, base, n_runs)

"""The likelihood of each objective, in NumPy. Twin of apf/filters/likelihoods.py."""

from __future__ import annotations

from apf.filters.method import Method
from apf.reference.filters.annealed import numpy_voxel_likelihood, numpy_with_keypoints
from apf.reference.image_objective.objective import NumpyImageObjective
from apf.reference.likelihood.base import NumpyLikelihood
from apf.scene import Scene


def build_voxel_objective(scene: Scene, method: Method, n_runs: int) -> NumpyLikelihood:
    """Return the voxels' likelihood of `method`, with the keypoints' if that has a weight."""
    return numpy_voxel_likelihood(scene, method.filter)


def build_keypoint_objective(scene: Scene, method: Method, n_runs: int) -> NumpyLikelihood:
    """Return the keypoints' likelihood of `method` alone."""
    return numpy_with_keypoints(scene, method.filter, None)


def build_image_objective(scene: Scene, method: Method, n_runs: int) -> NumpyLikelihood:
    """Return the image objective of `method`, with the keypoints' if that has a weight."""
    base = NumpyImageObjective(scene, method.filter.search.n_particles, method.image)
    return numpy_with_keypoints(scene, method.filter, base)

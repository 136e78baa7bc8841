"""The objectives voxel and keypoints: the voxels' likelihood, and keypoints alone."""

from __future__ import annotations

from apf.filters.objectives import ObjectiveSpec

OBJECTIVE = (
    ObjectiveSpec(
        "voxel",
        "voxels",
        likelihood="apf.filters.likelihoods:of_voxels",
        twin="apf.reference.filters.likelihoods:of_voxels",
        shares_launches=True,
    ),
    ObjectiveSpec(
        "keypoints",
        "nothing",
        likelihood="apf.filters.likelihoods:of_keypoints",
        twin="apf.reference.filters.likelihoods:of_keypoints",
        shares_launches=True,
    ),
)

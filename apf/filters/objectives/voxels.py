"""The objectives voxel and keypoints: the voxels' likelihood, and keypoints alone."""

from __future__ import annotations

from apf.filters.objectives import ObjectiveSpec

OBJECTIVE = (
    ObjectiveSpec(
        "voxel",
        "voxels",
        likelihood="apf.filters.likelihoods:build_voxel_objective",
        twin="apf.reference.filters.likelihoods:build_voxel_objective",
        shares_launches=True,
    ),
    ObjectiveSpec(
        "keypoints",
        "nothing",
        likelihood="apf.filters.likelihoods:build_keypoint_objective",
        twin="apf.reference.filters.likelihoods:build_keypoint_objective",
        shares_launches=True,
    ),
)

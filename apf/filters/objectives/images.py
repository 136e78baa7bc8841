"""The objectives over image features (Rymut 2016 eq. (4.46)-(4.50))."""

from __future__ import annotations

from apf.filters.objectives import ObjectiveSpec
from apf.image_objective.config import OBJECTIVE_KINDS, FeatureConfig, ObjectiveConfig

OBJECTIVE = tuple(
    ObjectiveSpec(
        kind,
        "images",
        likelihood="apf.filters.likelihoods:build_image_objective",
        twin="apf.reference.filters.likelihoods:build_image_objective",
        settings={"image": ObjectiveConfig, "features": FeatureConfig},
    )
    for kind in OBJECTIVE_KINDS
)

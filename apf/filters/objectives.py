"""The objectives that are registered: what a search judges poses by.

Packages register others by the entry point psfs_apf.objectives. Likelihoods and twins are named,
not imported: settings are read without OpenCL.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from apf.image_objective.config import OBJECTIVE_KINDS, FeatureConfig, ObjectiveConfig
from psfs.common.registry import Registry

#: What an objective observes of a frame beside keypoints.
Observes = Literal["voxels", "images", "nothing"]


@dataclass(frozen=True)
class ObjectiveSpec:
    """An objective as it is registered: in `OBJECTIVES`, or by an entry point of a package.

    name: by which --objective chooses it. likelihood, twin: functions (scene, method)
    that return a `Likelihood` and a `NumpyLikelihood`, as "package.module:function"; they are
    imported when they are used. settings: classes of the objective's own, each a part of `Method`
    by that name.
    """

    name: str
    observes: Observes
    likelihood: str
    twin: str
    settings: Mapping[str, type] = field(default_factory=dict)


_OF_VOXELS = (
    ObjectiveSpec(
        "voxel",
        "voxels",
        likelihood="apf.filters.annealed:build_voxel_objective",
        twin="apf.reference.filters.annealed:build_voxel_objective",
    ),
    ObjectiveSpec(
        "keypoints",
        "nothing",
        likelihood="apf.filters.annealed:build_keypoint_objective",
        twin="apf.reference.filters.annealed:build_keypoint_objective",
    ),
)
#: Rymut 2016 eq. (4.46)-(4.50).
_OF_IMAGES = tuple(
    ObjectiveSpec(
        kind,
        "images",
        likelihood="apf.filters.annealed:build_image_objective",
        twin="apf.reference.filters.annealed:build_image_objective",
        settings={"image": ObjectiveConfig, "features": FeatureConfig},
    )
    for kind in OBJECTIVE_KINDS
)

#: Every registered objective.
OBJECTIVES = Registry(ObjectiveSpec, "psfs_apf.objectives", (*_OF_VOXELS, *_OF_IMAGES))

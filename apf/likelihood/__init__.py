"""How badly poses fit the voxels: Song et al. eq. (14)-(16), and more terms."""

from apf.likelihood.base import Likelihood, PointSubset
from apf.likelihood.config import (
    ContourConfig,
    LikelihoodConfig,
    MotionPriorConfig,
    PartColourConfig,
)
from apf.likelihood.contour import Contours
from apf.likelihood.motion_prior import MotionPrior
from apf.likelihood.part_colour import PartColours
from apf.likelihood.silhouette_recall import SilhouetteRecall
from apf.likelihood.voxel import VoxelLikelihood

__all__ = [
    "ContourConfig",
    "Contours",
    "Likelihood",
    "LikelihoodConfig",
    "MotionPrior",
    "MotionPriorConfig",
    "PartColourConfig",
    "PartColours",
    "PointSubset",
    "SilhouetteRecall",
    "VoxelLikelihood",
]

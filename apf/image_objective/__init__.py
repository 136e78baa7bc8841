"""Objectives over image features: silhouettes and edges, compared with rendered bodies.

Kwolek & Rymut 2016; Rymut 2016, chapters 2, 4 and 5.
"""

from apf.image_objective.config import FeatureConfig, ObjectiveConfig, ProximityConfig
from apf.image_objective.features import Features
from apf.image_objective.objective import ImageObjective
from apf.image_objective.opengl import OpenGLObjective
from apf.image_objective.renderer import draw_hypotheses
from apf.likelihood.observations import FeatureMaps

__all__ = [
    "FeatureConfig",
    "FeatureMaps",
    "Features",
    "ImageObjective",
    "ObjectiveConfig",
    "OpenGLObjective",
    "ProximityConfig",
    "draw_hypotheses",
]

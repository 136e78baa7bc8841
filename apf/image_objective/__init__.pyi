from .config import FeatureConfig as FeatureConfig
from .config import ObjectiveConfig as ObjectiveConfig
from .config import ProximityConfig as ProximityConfig
from .features import Features as Features
from .objective import ImageObjective as ImageObjective
from .opengl import OpenGLObjective as OpenGLObjective
from .renderer import draw_hypotheses as draw_hypotheses

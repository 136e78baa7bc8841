from .context import egl_context as egl_context
from .objective import OpenGLObjective as OpenGLObjective
from .renderer import OpenGLRenderer as OpenGLRenderer

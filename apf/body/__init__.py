"""The body: bones with free axes, cones and meshes around them, and their kinematics."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

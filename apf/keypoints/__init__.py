"""2-D keypoints of any pose network: files, points on the body, triangulation."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

"""The automatic start: body and first pose of a person from the first voxel clouds."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

"""The automatic start: a person's body and first pose from the first voxel clouds alone."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

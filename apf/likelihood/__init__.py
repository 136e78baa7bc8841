"""How badly poses fit the voxels: Song et al. eq. (14)-(16), and more terms."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

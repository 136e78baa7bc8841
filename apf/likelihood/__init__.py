"""How badly poses fit the voxels: Song et al. eq. (14)-(16), and more terms."""

import lazy_loader as _lazy

# The names are in __init__.pyi; each is imported when it is first asked for: packages that
# register a term import `apf.likelihood.term`, which must not load the registered ones.
__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

"""Objectives over image features: silhouettes and edges, compared with rendered bodies.

Kwolek & Rymut 2016; Rymut 2016, chapters 2, 4 and 5.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

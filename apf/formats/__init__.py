"""Motion file formats by file ending: `WRITERS` need points only, `BODY_WRITERS` need the body."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

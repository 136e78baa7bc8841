"""File formats of motion: writers by the ending of their files, in `WRITERS` those that need points
alone, in `BODY_WRITERS` those that need the body."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

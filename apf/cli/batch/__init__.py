"""`apf batch`: the command, the list of takes, and the processing of a take by a worker."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

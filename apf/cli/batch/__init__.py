"""`apf batch`: the command, the takes it is given, and what a worker does with one."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

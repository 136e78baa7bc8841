"""The searches: annealed particle filter (Song et al. 2.3; Deutscher & Reid 2005), swarm and SIR
filter (Rymut 2016), and what refines their estimates."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

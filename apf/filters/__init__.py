"""The searches: annealed particle filter (Song et al. 2.3; Deutscher & Reid 2005), swarm and SIR
filter (Rymut 2016), and what refines their estimates."""

import lazy_loader as _lazy

# The names are in __init__.pyi; each is imported when it is first asked for: packages that
# register a search import `apf.filters.searches`, which must not load the registered ones.
__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

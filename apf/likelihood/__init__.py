"""How badly poses fit the voxels: Song et al. eq. (14)-(16), and more terms.

Nothing is imported here: packages that register a term import `apf.likelihood.term`, which must
not load the registered terms, theirs among them.
"""

"""The searches: annealed particle filter (Song et al. 2.3; Deutscher & Reid 2005), swarm and SIR
filter (Rymut 2016), and what refines their estimates.

Nothing is imported here: packages that register a search import `apf.filters.search`, which must
not load the registered ones, theirs among them.
"""

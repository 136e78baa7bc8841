"""The search apf: the annealed particle filter."""

from __future__ import annotations

from apf.filters.searches import SearchSpec

SEARCH = SearchSpec(
    "apf",
    "annealed particle filter",
    tracker="apf.filters.annealed:AnnealedParticleFilter",
    twin="apf.reference.filters.annealed:NumpyAnnealedParticleFilter",
    shares_launches=True,
)

"""The search pso: a particle swarm."""

from __future__ import annotations

import math
from dataclasses import dataclass

from apf.filters.searches import SearchSpec
from cl import InputError


@dataclass(frozen=True)
class SwarmConfig:
    """Factors of Rymut 2016 eq. (2.27), who does not state his.

    By hand: these contract faster than those that Clerc & Kennedy (2002) derive for long searches
    (0.73, 1.5, 1.5), which ten iterations are not.
    """

    inertia: float = 0.6
    """w, share of its velocity that a particle keeps, from 0 to less than 1."""
    cognitive: float = 1.2
    """c1, pull of a particle's own best."""
    social: float = 1.2
    """c2, pull of the best of all."""

    def __post_init__(self) -> None:
        factors = (self.inertia, self.cognitive, self.social)
        if not (0 <= self.inertia < 1 and min(factors) >= 0 and sum(factors) < math.inf):
            raise InputError(
                f"the swarm's inertia is {self.inertia}, its factors {self.cognitive} and "
                f"{self.social}; expected 0 <= inertia < 1 and factors from 0 on"
            )


SEARCH = SearchSpec(
    "pso",
    "particle swarm",
    tracker="apf.filters.swarm:ParticleSwarm",
    twin="apf.reference.filters.swarm:NumpyParticleSwarm",
    settings={"swarm": SwarmConfig},
    # By hand: a swarm has no annealing, so that more particles spread wider at once; it compares
    # errors of different iterations, which therefore look at the same points; and its parent, the
    # best of all, is a poor guide to velocity.
    defaults={"n_particles": 300, "point_turns": 1, "noise": 0.5, "velocity": 0.0},
)

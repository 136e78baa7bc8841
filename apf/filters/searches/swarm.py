"""The search pso: a particle swarm."""

from __future__ import annotations

from typing import ClassVar

from apf.filters.searches import SearchSpec
from psfs.common.config import Config, nonnegative, setting


class SwarmConfig(Config):
    """Factors of a particle swarm, Rymut 2016 eq. (2.27), who does not state his."""

    SOURCE: ClassVar = (
        "by hand: these contract faster than those that Clerc & Kennedy (2002) derive for long "
        "searches (0.73, 1.5, 1.5), which ten iterations are not"
    )

    inertia: float = setting(
        0.6,
        "Share w of its velocity that a particle keeps.",
        least=0,
        below=1,
        flag="--inertia",
        flag_help="pso: share of its velocity that a particle keeps",
    )
    cognitive: float = nonnegative(
        1.2,
        "Pull c1 of a particle's own best.",
        flag="--cognitive",
        flag_help="pso: pull of a particle's own best",
    )
    social: float = nonnegative(
        1.2,
        "Pull c2 of the best of all.",
        flag="--social",
        flag_help="pso: pull of the best of all",
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

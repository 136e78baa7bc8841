"""The search sir: a particle filter with resampling."""

from __future__ import annotations

from apf.filters.searches import SearchSpec
from psfs.common.config import Config, nonnegative


class SirConfig(Config):
    """The observation model of a particle filter with resampling, Rymut 2016 eq. (2.42)."""

    sigma_z: float = nonnegative(
        0.0,
        "Standard deviation of 1 - f; with 0 it is computed in each frame such that the "
        "effective sample size is `SearchConfig.first_survival` of the particles.",
        "not stated by Rymut",
        flag="--sigma-z",
        flag_help="sir: of Rymut eq. (2.42), 0 for one found in each frame",
    )

    @property
    def beta(self) -> float:
        """The exponent of exp(-(1 - f)^2), 0 for one to be found."""
        return self.sigma_z**-2 if self.sigma_z > 0 else 0.0


SEARCH = SearchSpec(
    "sir",
    "particle filter",
    tracker="apf.filters.sir:SirParticleFilter",
    twin="apf.reference.filters.sir:NumpySirParticleFilter",
    settings={"sir": SirConfig},
    # By hand: its one layer must reach as far as the others' layers together.
    defaults={
        "n_particles": 3000,
        "n_layers": 1,
        "first_survival": 0.02,
        "noise": 1.0,
        "velocity": 0.0,
    },
)

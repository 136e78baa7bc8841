"""The search sir: a particle filter with resampling."""

from __future__ import annotations

from dataclasses import dataclass

from apf.filters.searches import SearchSpec
from psfs.common.ranges import check_range


@dataclass(frozen=True)
class SirConfig:
    """The observation model of Rymut 2016 eq. (2.42)."""

    sigma_z: float = 0.0
    """Deviation of 1 - f; 0, the default, finds it anew in each frame, such that the effective
    sample size is `SearchConfig.first_survival` of the particles (Rymut does not state his)."""

    def __post_init__(self) -> None:
        check_range("sigma_z", self.sigma_z, 0, ends=True)

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

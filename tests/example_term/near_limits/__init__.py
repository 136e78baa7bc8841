"""A term of the likelihood: poses near the limits of the joints cost something."""

from __future__ import annotations

from dataclasses import dataclass

from apf.likelihood.terms import Parity, TermSpec
from psfs.common.ranges import check_range


@dataclass(frozen=True)
class NearLimitsConfig:
    """How near a pose is to the limits of the joints: mean square over degrees of freedom."""

    weight: float = 0.0
    """Of that mean, in one camera's error. Off, as all terms of other packages are."""
    free: float = 0.8
    """Share of the way from the middle to a limit that costs nothing. By hand."""

    def __post_init__(self) -> None:
        check_range("near_limits_weight", self.weight, 0, ends=True)
        check_range("near_limits_free", self.free, 0, 1)


TERM = TermSpec(
    "near_limits",
    NearLimitsConfig,
    launcher="near_limits.term:NearLimits",
    twin="near_limits.term:NumpyNearLimits",
    parity=Parity({"weight": 2.0, "free": 0.3}, ("near_limits:near_limits.add_limit_errors",)),
    chosen_weight=0.5,
)

"""A term of the likelihood: poses near the limits of the joints cost something."""

from apf.likelihood.terms import Parity, TermSpec
from psfs.common.config import Config, setting


class NearLimitsConfig(Config):
    """How near a pose is to the limits of the joints: mean square over degrees of freedom."""

    weight: float = setting(
        0.0,
        "Weight of that mean in one camera's error.",
        "off, as all terms of other packages are",
        least=0,
    )
    free: float = setting(
        0.8,
        "Share of the way from the middle to a limit that costs nothing.",
        "by hand",
        above=0,
        below=1,
    )


TERM = TermSpec(
    "near_limits",
    NearLimitsConfig,
    launcher="near_limits.term:NearLimits",
    twin="near_limits.term:NumpyNearLimits",
    parity=Parity({"weight": 2.0, "free": 0.3}, ("near_limits:near_limits.add_limit_errors",)),
    chosen_weight=0.5,
)

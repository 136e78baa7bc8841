"""The term motion_prior: the change of the pose since the last frame."""

from __future__ import annotations

from dataclasses import dataclass

from apf.likelihood.terms import Parity, TermSpec
from psfs.common.ranges import check_range


@dataclass(frozen=True)
class MotionPriorConfig:
    """The mean squared change since the last frame, in the body's sigmas."""

    weight: float = 0.0
    """Of the mean, in one camera's error. Off: the particles' noise bounds the change anyway."""
    scale: float = 1.0
    """Sigmas of the body, at 60 frames/s, that count as one. By definition of the sigmas."""

    def __post_init__(self) -> None:
        check_range("motion_prior_weight", self.weight, 0, ends=True)
        check_range("motion_prior_scale", self.scale, 0)


TERM = TermSpec(
    "motion_prior",
    MotionPriorConfig,
    launcher="apf.likelihood.motion_prior:MotionPrior",
    twin="apf.reference.likelihood.motion_prior:NumpyMotionPrior",
    parity=Parity(
        {"weight": 0.3, "scale": 2.0},
        ("tracking/motion_prior.add_motion_errors", "tracking/motion_prior.expect_motion"),
    ),
    chosen_weight=0.01,  # by hand
    depends_on_track=True,
    per_interval=("scale",),
)

"""The term motion_prior: the change of the pose since the last frame."""

from __future__ import annotations

from apf.likelihood.terms import Parity, TermSpec
from psfs.common.config import Config, nonnegative, positive


class MotionPriorConfig(Config):
    """The mean squared change since the last frame, in the body's sigmas."""

    weight: float = nonnegative(
        0.0,
        "Weight of that mean in one camera's error.",
        "off: the particles' noise bounds the change anyway",
    )
    scale: float = positive(
        1.0,
        "Change at 60 frames/s whose squared length is 1.",
        "by definition of the sigmas",
        "of the body's sigmas",
    )


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

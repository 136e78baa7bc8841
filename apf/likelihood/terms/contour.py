"""The term contour: contours of the pictures along the outlines of limbs."""

from __future__ import annotations

from apf.likelihood.terms import Parity, TermSpec
from psfs.common.config import Config, nonnegative, setting


class ContourConfig(Config):
    """Change of the pictures across the outlines of limbs and head, averaged over the parts of the
    outlines that a camera sees."""

    weight: float = nonnegative(
        8.0,
        "Weight of 1 minus that mean in one camera's error.",
        "tuned on the six suite sequences: 4 to 12 differ little",
    )
    contrast: float = setting(
        7.5,
        "Change of the picture that counts as a full contour.",
        "tuned: 4 does as well, 12 worse",
        "grey levels per px",
        above=0,
        below=255,
    )


TERM = TermSpec(
    "contour",
    ContourConfig,
    launcher="apf.likelihood.contour:Contours",
    twin="apf.reference.likelihood.contour:NumpyContours",
    parity=Parity(
        {"weight": 1.5},
        ("tracking/contour.differentiate", "tracking/contour.find_contours"),
        atol=0.02,  # of each camera: rounding moves a sample to the next pixel
    ),
)

"""The term contour: contours of the pictures along the outlines of limbs."""

from __future__ import annotations

from dataclasses import dataclass

from apf.likelihood.terms import Parity, TermSpec
from psfs.common.ranges import check_range


@dataclass(frozen=True)
class ContourConfig:
    """How much the pictures change across the outlines of limbs and head, the mean over what a
    camera sees of them."""

    weight: float = 8.0
    """Of what that mean lacks of 1, in one camera's error. Tuned on the six suite sequences: 4 to
    12 differ little."""
    contrast: float = 7.5
    """Grey values per pixel that count in full. Tuned: 4 does as well, 12 worse."""

    def __post_init__(self) -> None:
        check_range("contour_weight", self.weight, 0, ends=True)
        check_range("contour_contrast", self.contrast, 0, 255)


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

"""The term part_colour: the colours of the body's parts."""

from __future__ import annotations

from dataclasses import dataclass

from apf.likelihood.terms import Parity, TermSpec
from psfs.common.ranges import check_range


@dataclass(frozen=True)
class PartColourConfig:
    """Whether parts have their colours in the pictures: the mean, over what a camera sees of limbs
    and head, of how much likelier a colour is there than elsewhere on the person."""

    weight: float = 4.0
    """Of that mean, as a share of its bound, in one camera's error. Tuned on the six suite
    sequences with `surface_weight`: 1 gains half as much, 8 nothing more."""
    n_colours: int = 48
    """Colours of the palette, at most 63. Tuned: a fixed grid of 256 tells skin from a red shirt
    worse."""
    decay: float = 0.97
    """What histograms keep from frame to frame, in [0, 1): about a second at 30 frames/s. By
    hand."""
    bound: float = 2.0
    """Log ratios are cut there: a colour never seen on a part is not impossible. By hand."""
    rare: float = 0.004
    """Likelihood of a code on a part that never showed it. By hand."""
    least_samples: float = 60.0
    """Samples from which a part's ratios count in full. By hand: of fewer they say little."""
    least_pixels: int = 500
    """Pixels of a person from which a palette is made. By hand."""

    def __post_init__(self) -> None:
        check_range("part_colour_weight", self.weight, 0, ends=True)
        check_range("part_colour_n_colours", self.n_colours, 2, 63, ends=True)
        check_range("part_colour_decay", self.decay, 0, 1, ends=True)
        for name in ("bound", "rare", "least_samples", "least_pixels"):
            check_range(f"part_colour_{name}", getattr(self, name), 0)


TERM = TermSpec(
    "part_colour",
    PartColourConfig,
    launcher="apf.likelihood.part_colour:PartColours",
    twin="apf.reference.likelihood.part_colour:NumpyPartColours",
    parity=Parity(
        {"weight": 1.5},
        (
            "tracking/part_colour.encode_colours",
            "tracking/part_colour.count_colours",
            "tracking/part_colour.learn_colours",
        ),
        atol=0.02,  # of each camera: rounding moves a sample to the next pixel
    ),
)

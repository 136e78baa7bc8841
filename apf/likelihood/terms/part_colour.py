"""The term part_colour: the colours of the body's parts."""

from __future__ import annotations

from typing import ClassVar

from apf.likelihood.terms import Parity, TermSpec
from psfs.common.config import Config, nonnegative, positive, setting


class PartColourConfig(Config):
    """Agreement of the pictures with the colours of the body's parts. The term is the mean log
    likelihood ratio of the visible colours, on their part relative to the whole person, over the
    limbs and head that a camera sees."""

    SOURCE: ClassVar = "by hand"

    weight: float = nonnegative(
        4.0,
        "Weight of that mean, as a share of its bound, in one camera's error.",
        "tuned on the six suite sequences with `surface_weight`: 1 gains half as much, 8 nothing "
        "more",
    )
    n_colours: int = setting(
        48,
        "Number of colours of the palette.",
        "tuned: a fixed grid of 256 colours distinguishes skin and a red shirt less well",
        least=2,
        most=62,
    )
    decay: float = setting(
        0.97,
        "Share that histograms keep from frame to frame: about a second at 30 frames/s.",
        least=0,
        below=1,
    )
    bound: float = positive(
        2.0, "Bound of the log ratios, so that no colour is impossible on a part.", unit="nats"
    )
    rare: float = positive(0.004, "Likelihood of a code on a part that never showed it.")
    least_samples: float = positive(
        60.0, "Number of samples from which on a part's ratios count in full."
    )
    least_pixels: int = positive(
        500, "Number of pixels of a person from which a palette is made.", unit="px"
    )


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

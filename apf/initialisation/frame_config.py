"""Settings of the frames that the automatic start looks at."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, natural, nonnegative, positive

#: The source of defaults that name no other source.
TUNED = "tuned"


class FrameChoice(Config):
    """Choice of the frames for a start, and definition of a person in them."""

    SOURCE: ClassVar = TUNED

    n_fitted: int = natural(10, "Number of frames that the body is fitted to.")
    duration: float = positive(
        1.0,
        "Time over which these frames are spread; as long as a stride, so that the legs separate.",
        "a person who stoops for 0.8 s is estimated 1 % too short, and so is one with a high "
        "kick within 1.2 s",
        "s",
    )
    n_between: int = nonnegative(
        1, "Approximate number of frames between two fitted ones, which are only tracked."
    )
    n_searched: int = natural(
        4, "Number of fitted frames that are searched over all headings, first and last among them."
    )
    min_voxels: int = natural(200, "Fewest surface voxels that can be a person.", unit="voxels")
    min_part: float = fraction(
        0.05,
        "Share of the largest connected part below which another part is debris, unless it is "
        "near.",
    )
    min_near_part: float = fraction(
        0.01,
        "The same share for parts near those that are not debris, such as a head without its neck.",
    )
    near: float = nonnegative(0.15, "Distance within which a part is near.", unit="m")

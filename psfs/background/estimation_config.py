"""Settings of the background's estimation from pictures of the empty scene or from the take."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, natural, nonnegative, positive


class BackgroundModelConfig(Config):
    """Settings of the background's estimation from pictures of the empty scene, see
    `psfs.background.gaussian`."""

    SOURCE: ClassVar = "by hand"

    std_floor: float = positive(
        2.0,
        "Least standard deviation of the background's estimate: without it, N(I; mu, sigma) of"
        " a noiseless background would be unbounded.",
        unit="grey levels",
    )
    prior_std: float = positive(
        6.0, "Prior standard deviation of a pixel, before any frame is read.", unit="grey levels"
    )
    prior_frames: float = nonnegative(
        2.0,
        "Weight of `prior_std`; a background of a single picture thus has a standard deviation"
        " of 4.9 grey levels.",
        unit="frames",
    )
    clip: float = positive(
        3.0,
        "Distance from the mean beyond which a value is left out of it.",
        "the usual 3 sigma",
        "standard deviations",
    )
    samples: int = natural(
        25,
        "Number of frames from which the background is estimated if there is no film of the "
        "empty scene.",
        "by hand: enough for a median",
        "frames",
    )
    mixture_samples: int = natural(
        50,
        "Number of frames to which mixtures of Gaussians are fitted if there is no film of the"
        " empty scene.",
        unit="frames",
    )
    mixture_rate: float = fraction(
        0.0005,
        "Learning rate of an adaptive mixture, alpha of Rymut 2016 eq. (2.5). OpenCV counts a "
        "component as background once it is a tenth of the mixture, so a person may stand "
        "still for 210 frames.",
        "by hand; Rymut does not state his",
    )

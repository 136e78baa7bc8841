"""Settings of the calibration by a person."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, nonnegative, positive, setting


class PersonConfig(Config):
    """Settings of the calibration of cameras by a person who walks about."""

    SOURCE: ClassVar = "by hand"

    stature: float = setting(
        1.7,
        "Height of the person, which gives the scale where none is stated.",
        "an adult's",
        "m",
        above=0.3,
        most=3.0,
    )
    longest_lag: float = setting(
        1.5, "Longest time by which one camera may be behind another.", unit="s", least=0, most=60
    )
    most_frames: int = setting(
        300, "Number of frames of a camera that are used, the first ones.", least=20
    )
    worst_direction: float = positive(
        0.0087, "Greatest standard deviation of a camera's direction.", "0.5 degrees", "rad"
    )
    worst_position: float = fraction(
        0.015, "The same of its position, as a share of the cameras' distance from the person."
    )
    confidence: float = fraction(0.5, "Least confidence of a keypoint that is used.")
    worst_keypoint: float = setting(
        0.006, "Greatest median error of a camera's keypoints, as a share of the picture's longest "
        "side.", above=0, below=0.1,
    )  # fmt: skip
    focal: float = nonnegative(
        0.0,
        "Standard deviation of the focal length's logarithm, as where only an angle of view is "
        "stated; 0: it is kept.",
    )

"""Settings of the calibration by a person's keypoints."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, natural, nonnegative, positive, setting


class PointsConfig(Config):
    """Calibration of cameras by keypoints of a person who moves."""

    SOURCE: ClassVar = "by hand on `synth_walk_4cam` and `pose2sim_balance`"

    confidence: float = fraction(0.5, "Least confidence of a keypoint that is used.")
    noise: float = positive(
        0.002, "Noise of keypoints, as a share of the picture's longest side, in the first rounds."
    )
    most_frames: int = natural(150, "Most frames that are used, evenly spread.")
    most_pairs: int = natural(600, "Most keypoints of two cameras that are compared at each lag.")
    fewest: int = natural(60, "Fewest keypoints that two neighbouring cameras must share.")
    parallax: float = positive(
        4.0, "Least median angle between the rays of the two cameras that are placed first.",
        unit="degrees",
    )  # fmt: skip
    starts: int = natural(4, "Pairs of cameras from which a start is tried.")
    rounds: int = natural(12, "Steps of the adjustment after a camera is added.")
    last: int = natural(20, "Steps of each of the last adjustments.")
    widths: tuple[float, ...] = setting(
        (2, 1),
        "Least noise in the last adjustments, one after another, as multiples of `noise`.",
    )
    reach: float = positive(
        3.0, "Width of the robust weights, in standard deviations of the errors."
    )
    rigid: float = positive(
        0.04, "Standard deviation of a limb's length from frame to frame, as a share of it."
    )
    time: float = positive(1.0, "Standard deviation of a fraction of a lag.", unit="frames")
    focal: float = nonnegative(
        0.0, "Standard deviation of the focal length's logarithm; 0: it is kept."
    )
    worst: float = setting(
        0.006, "Greatest median error of a camera, as a share of the picture's longest side.",
        above=0, below=0.1,
    )  # fmt: skip
    lens: float = positive(0.1, "The same where only an angle of view is stated.")

    def free_lenses(self) -> PointsConfig:
        """Return these settings with focal lengths that are adjusted, too."""
        return self.replace(focal=self.lens)

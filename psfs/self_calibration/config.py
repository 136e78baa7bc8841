"""Settings of the calibration by a person."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, nonnegative, part, positive, setting
from psfs.diagnostics.config import AlignmentConfig, LimbConfig

#: Tips count alike, however fast.
_ALIKE = {"bend": 1.0, "information": 0.2, "half_speed": 1e9}


class PointsConfig(Config):
    """Calibration of cameras by keypoints of a person who moves."""

    SOURCE: ClassVar = "by hand"

    confidence: float = fraction(0.5, "Least confidence of a keypoint that is used.")
    noise: float = positive(
        0.002, "Noise of keypoints, as a share of the picture's longest side, in the first rounds."
    )
    rigid: float = positive(
        0.04, "Standard deviation of a limb's length from frame to frame, as a share of it."
    )
    worst: float = setting(
        0.006, "Greatest median error of a camera, as a share of the picture's longest side.",
        above=0, below=0.1,
    )  # fmt: skip


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
    longest_side: int = setting(640, "Longest side of the pictures used.", unit="px", least=64)
    most_frames: int = setting(
        300, "Number of frames of a camera that are used, the first ones.", least=20
    )
    worst_direction: float = positive(
        0.0087, "Greatest standard deviation of a camera's direction.", "0.5 degrees", "rad"
    )
    worst_position: float = fraction(
        0.015, "The same of its position, as a share of the cameras' distance from the person."
    )
    false_positive_rate: float = fraction(
        0.01, "Rate at which an arrangement that fits as well is taken to fit worse."
    )
    focal: float = nonnegative(
        0.0, "Standard deviation of the focal length's logarithm; 0: it is kept."
    )
    #: Steps while the arrangement is uncertain.
    wide: AlignmentConfig = part(
        AlignmentConfig, turn=0.1, shift=0.3, focal=1e-4, time=5.0, **_ALIKE
    )
    #: Steps when the arrangement is known.
    narrow: AlignmentConfig = part(
        AlignmentConfig, turn=0.05, shift=0.2, focal=1e-4, time=5.0, noise=0.25, **_ALIKE
    )
    #: Medial axes of limbs, in the last passes.
    limbs: LimbConfig = part(LimbConfig, per_camera=2400)
    points: PointsConfig = part(PointsConfig)

    def free_lenses(self) -> PersonConfig:
        """Return these settings with focal lengths that are adjusted, too, as where only an angle
        of view is stated."""
        steps = {"focal": 0.03}
        return self.replace(focal=0.1, wide=self.wide.replace(**steps),
                            narrow=self.narrow.replace(**steps))  # fmt: skip

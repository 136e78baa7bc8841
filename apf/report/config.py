"""Settings of the verdict on a track."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, positive, setting


class QualityConfig(Config):
    """Limits of the verdict on a track without truth, see `apf/report/quality.py`."""

    SOURCE: ClassVar = "by hand"

    inside: float = setting(
        0.7,
        "Share inside the silhouettes at which a part is as likely right as wrong.",
        "wrong upper arms and thighs: 0.2 to 0.5, a wrong forearm 0.65, right parts 0.87 and more",
        above=0,
        below=1,
    )
    halved: float = positive(
        0.1,
        "Standard deviation of a limb's end that halves its confidence.",
        "half of the error from which `apf evaluate` counts a limb as lost",
        unit="m",
    )
    explained: float = fraction(
        0.88,
        "Share of surface voxels, or of keypoints, near the body below which a frame should be "
        "checked.",
        "an arm is more than the rest; hulls of few cameras leave up to 0.06 without a fault; "
        "left and right exchanged in one camera of five leaves 0.86 of the keypoints",
    )
    good: float = positive(
        0.045,
        "Greatest expected error of a good track.",
        "of 112 tracks below it one had 2 % of its joints beyond 150 mm, of 23 above it 17",
        unit="m",
    )
    bad: float = positive(0.075, "Least expected error of a bad track.", unit="m")


class MotionConfig(Config):
    """Limits of what people do, see `apf/report/motion_limits.py`."""

    SOURCE: ClassVar = "by hand: people walk, run, dance, lunge and kick within them"

    backward: float = fraction(0.75, "Least share backward of all that is walked; in lunges 0.3.")
    fall: float = setting(
        1.5,
        "Least downward acceleration of the centre of mass that nobody has, in g.",
        "1 for a point mass; a kick, whose mass is estimated, reaches 1.25",
        above=1,
    )
    steps: float = setting(
        1.25,
        "Least steps per second that nobody takes, as a multiple of the usual ones at that speed.",
        "at a frame rate stated twice too high 1.5: twice the steps at twice the speed",
        above=1,
    )
    window: float = positive(
        0.05,
        "Standard deviation of the filter of joints, velocities and accelerations.",
        unit="s",
    )

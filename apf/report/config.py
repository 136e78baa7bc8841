"""Settings of the verdict on a track."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, nonnegative, positive, setting


class QualityConfig(Config):
    """Limits of the verdict on a track without truth, see `apf/report/quality.py`."""

    SOURCE: ClassVar = "by hand, on synthetic walks and the recordings at hand"

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
    steepness: float = setting(
        4.0, "Power of that deviation by which the confidence falls.", above=0, most=100
    )
    explained: float = fraction(
        0.9,
        "Share of surface voxels near the body below which a frame should be checked.",
        "an arm is more than the rest; hulls of few cameras leave up to 0.06 without a fault",
    )
    near: float = fraction(
        0.88,
        "Share of keypoints near their points on the body below which a frame should be checked.",
        "sound keypoints: 0.92 and more; left and right exchanged in one camera of five: 0.86",
    )
    good: float = fraction(0.02, "Greatest share of doubtful frames of a good track.")
    bad: float = fraction(0.25, "Least share of doubtful frames of a bad track.")
    doubtful_parts: float = fraction(
        0.1, "Least share of doubtful parts that confirms, with `overlap`, that a track is bad."
    )
    overlap: float = nonnegative(
        0.76,
        "Overlap of body and silhouettes, as a share of that of the voxels, below which they do "
        "not fit.",
        "right tracks: 0.80 and more, in a skirt 0.75",
    )
    away: float = fraction(
        0.5, "Share of frames with voxels away from the body that confirms that a track is bad."
    )
    fitting: float = fraction(
        0.25, "Share of keypoints near the body below which a track is certainly bad."
    )


class MotionConfig(Config):
    """Limits of what people do, see `apf/report/motion_limits.py`."""

    SOURCE: ClassVar = "by hand, on the true motion of the sequences at hand"

    lost: float = fraction(0.1, "Share of frames with a lost person from which nothing is judged.")
    walk_speed: float = positive(
        0.4, "Least speed of the pelvis that counts as walking.", unit="m/s"
    )
    backward_path: float = positive(
        0.6,
        "Least path of a walk backward.",
        "a lunge goes back by 0.54; 40 frames of a walk at 60 frames/s by 0.9",
        "m",
    )
    backward_share: float = fraction(
        0.75, "Least share of it in all that is walked; in lunges 0.3."
    )
    fall: float = setting(
        1.5,
        "Least downward acceleration of the centre of mass that nobody has, in g.",
        "1 for a point mass; a kick, whose mass is estimated, reaches 1.25",
        above=1,
    )
    window: float = positive(
        0.05,
        "Standard deviation of the filter of joints, velocities and accelerations.",
        unit="s",
    )
    fall_share: float = setting(
        0.05, "Share of the frames in which it must be as high.", above=0, most=1
    )
    fast_steps: float = positive(
        1.1,
        "Most steps, times sqrt(leg / g), of a quick walk or a run.",
        "walks 0.4 to 0.6, a run 0.7; twice as fast 1.14 and 1.41",
    )
    most_steps: float = positive(
        1.5, "Most steps, times sqrt(leg / g), at any speed.", "a dance reaches 1.0"
    )
    walks_on: float = positive(
        0.5,
        "Froude number from which people run rather than walk.",
        "Alexander 1989",
    )
    sprints: float = positive(3.0, "Froude number from which people sprint, with quicker steps.")

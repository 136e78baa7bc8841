"""Settings of the verdict on a track."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, setting


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
    halved: float = setting(
        0.1,
        "Standard deviation of a limb's end that halves its confidence.",
        "half of the error from which `apf evaluate` counts a limb as lost",
        unit="m",
        above=0,
    )
    steepness: float = setting(
        4.0, "Power of that deviation by which the confidence falls.", above=0, most=100
    )
    explained: float = setting(
        0.9,
        "Share of surface voxels near the body below which a frame should be checked.",
        "an arm is more than the rest; hulls of few cameras leave up to 0.06 without a fault",
        least=0,
        most=1,
    )
    near: float = setting(
        0.88,
        "Share of keypoints near their points on the body below which a frame should be checked.",
        "sound keypoints: 0.92 and more; left and right exchanged in one camera of five: 0.86",
        least=0,
        most=1,
    )
    good: float = setting(
        0.02, "Greatest share of doubtful frames of a good track.", least=0, most=1
    )
    bad: float = setting(0.25, "Least share of doubtful frames of a bad track.", least=0, most=1)
    doubtful_parts: float = setting(
        0.1,
        "Least share of doubtful parts that confirms, with `overlap`, that a track is bad.",
        least=0,
        most=1,
    )
    overlap: float = setting(
        0.76,
        "Overlap of body and silhouettes, as a share of that of the voxels, below which they do "
        "not fit.",
        "right tracks: 0.80 and more, in a skirt 0.75",
        least=0,
    )
    away: float = setting(
        0.5,
        "Share of frames with voxels away from the body that confirms that a track is bad.",
        least=0,
        most=1,
    )
    fitting: float = setting(
        0.25,
        "Share of keypoints near the body below which a track is certainly bad.",
        least=0,
        most=1,
    )


class MotionConfig(Config):
    """Limits of what people do, see `apf/report/motion_limits.py`."""

    SOURCE: ClassVar = "by hand, on the true motion of the sequences at hand"

    lost: float = setting(
        0.1, "Share of frames with a lost person from which nothing is judged.", least=0, most=1
    )
    walk_speed: float = setting(
        0.4, "Least speed of the pelvis that counts as walking.", unit="m/s", above=0
    )
    backward_path: float = setting(
        0.6,
        "Least path of a walk backward.",
        "a lunge goes back by 0.54; 40 frames of a walk at 60 frames/s by 0.9",
        "m",
        above=0,
    )
    backward_share: float = setting(
        0.75, "Least share of it in all that is walked; in lunges 0.3.", least=0, most=1
    )
    fall: float = setting(
        1.5,
        "Least downward acceleration of the centre of mass that nobody has, in g.",
        "1 for a point mass; a kick, whose mass is estimated, reaches 1.25",
        above=1,
    )
    window: float = setting(
        0.05,
        "Standard deviation of the filter of joints, velocities and accelerations.",
        unit="s",
        above=0,
    )
    fall_share: float = setting(
        0.05, "Share of the frames in which it must be as high.", above=0, most=1
    )
    fast_steps: float = setting(
        1.1,
        "Most steps, times sqrt(leg / g), of a quick walk or a run.",
        "walks 0.4 to 0.6, a run 0.7; twice as fast 1.14 and 1.41",
        above=0,
    )
    most_steps: float = setting(
        1.5, "Most steps, times sqrt(leg / g), at any speed.", "a dance reaches 1.0", above=0
    )
    walks_on: float = setting(
        0.5,
        "Froude number from which people run rather than walk.",
        "Alexander 1989",
        above=0,
    )
    sprints: float = setting(
        3.0, "Froude number from which people sprint, with quicker steps.", above=0
    )

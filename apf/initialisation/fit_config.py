"""Settings of the fits of body and pose to joints and to keypoints."""

from __future__ import annotations

from typing import ClassVar

from apf.initialisation.config import TUNED
from psfs.common.config import Config, part, setting


class JointFitConfig(Config):
    """The fit of body and pose to 3-D joints."""

    SOURCE: ClassVar = TUNED

    joint: float = setting(0.01, "Standard deviation of a joint's position.", unit="m", above=0)
    scale: float = setting(
        0.3,
        "Standard deviation of the log of a bone's scale; it matters only where the joints do "
        "not determine the scale.",
        above=0,
    )
    angle: float = setting(
        3.0,
        "Standard deviation of an angle from rest; it matters only where the joints do not "
        "determine the angle.",
        unit="rad",
        above=0,
    )
    max_log_scale: float = setting(
        1.0,
        "Largest log of a bone's scale, and the negative of the smallest: from 0.37 to 2.7 times.",
        above=0,
    )
    min_joints: int = setting(
        8,
        "Least number of known joints, or all joints of a body with fewer: enough for the "
        "root, and a joint in every limb.",
        least=1,
    )
    n_headings: int = setting(4, "Number of headings that are tried, evenly around.", least=1)
    n_trial: int = setting(
        8, "Number of evaluations after which only the best heading is pursued.", least=1
    )


class PointFitConfig(Config):
    """The fit of body and poses to points of the body in the cameras' images."""

    SOURCE: ClassVar = "by hand"

    size: float = setting(
        0.15, "Standard deviation of the log of the body's size: children, too.", above=0
    )
    length: float = setting(
        0.1, "Standard deviation of the log of a bone's length beside the size.", above=0
    )
    angle: float = setting(
        1.0,
        "Standard deviation of an angle from rest; it matters only where the points do not "
        "determine the angle.",
        unit="rad",
        above=0,
    )
    noise: float = setting(
        0.02,
        "Standard deviation of the triangulated points, to which the poses are fitted first.",
        unit="m",
        above=0,
    )
    stray: float = setting(
        0.15, "Distance at which a triangulated point counts a quarter.", unit="m", above=0
    )
    n_near_steps: int = setting(
        40, "Number of steps of every frame's pose towards the triangulated points.", least=0
    )
    n_steps: int = setting(
        12, "Number of Gauss-Newton steps of all unknowns on the reprojection error.", least=1
    )
    first_reach: float = setting(
        8.0,
        "Distance at which a point in a picture counts a quarter in the first of them (Geman & "
        "McClure 1987).",
        unit="standard deviations",
        above=0,
    )
    last_reach: float = setting(
        2.5,
        "The same distance in the last of them; those between are spaced geometrically.",
        unit="standard deviations",
        above=0,
    )
    damping: float = setting(
        1e-3, "Share of a pose's own normal matrix added to its diagonal (Levenberg 1944).", least=0
    )
    suspect: float = setting(
        1.5,
        "Factor of the median missed share above which a frame's pose is fitted again, from "
        "the poses of neighbouring frames and turned by half a turn.",
        above=0,
    )
    n_independent: float = setting(
        2.0,
        "Effective number of independent frames, relative to the priors of the shared "
        "unknowns; limited, because the network's errors and the model's errors are similar in"
        " all frames.",
        "tuned: with 20 hips and shoulders lie 40 mm off",
        above=0,
    )


class KeypointStartConfig(Config):
    """The estimation of body and points from keypoints."""

    SOURCE: ClassVar = "by hand"

    n_frames: int = setting(
        40, "Number of frames to which body and points are fitted, evenly spread.", least=1
    )
    error: float = setting(
        8.0,
        "Initial error of a keypoint.",
        unit="px at a picture height of 480 px",
        above=0,
    )
    outlier: float = setting(
        20.0,
        "Mean reprojection error above which cameras are excluded from a point.",
        unit="px at a picture height of 480 px",
        above=0,
    )
    least_points: int = setting(
        6, "Least number of triangulated points of a frame that is used.", least=1
    )
    n_levels: int = setting(
        5,
        "Number of levels of confidence for which the error is estimated, each with as many "
        "keypoints.",
        least=1,
    )
    least_error: float = setting(
        1.0, "Least error of any keypoint.", unit="px at a picture height of 480 px", above=0
    )
    fit: PointFitConfig = part(PointFitConfig, "The fit to points in the cameras' pictures.")

"""Settings of the fits of body and pose to joints and to keypoints."""

from __future__ import annotations

from typing import ClassVar

from apf.initialisation.config import TUNED
from psfs.common.config import Config, natural, nonnegative, part, positive


class JointFitConfig(Config):
    """The fit of body and pose to 3-D joints."""

    SOURCE: ClassVar = TUNED

    joint: float = positive(0.01, "Standard deviation of a joint's position.", unit="m")
    scale: float = positive(
        0.3,
        "Standard deviation of the log of a bone's scale; it matters only where the joints do "
        "not determine the scale.",
    )
    angle: float = positive(
        3.0,
        "Standard deviation of an angle from rest; it matters only where the joints do not "
        "determine the angle.",
        unit="rad",
    )
    max_log_scale: float = positive(
        1.0,
        "Largest log of a bone's scale, and the negative of the smallest: from 0.37 to 2.7 times.",
    )
    min_joints: int = natural(
        8,
        "Least number of known joints, or all joints of a body with fewer: enough for the "
        "root, and a joint in every limb.",
    )
    n_headings: int = natural(4, "Number of headings that are tried, evenly around.")
    n_trial: int = natural(8, "Number of evaluations after which only the best heading is pursued.")


class PointFitConfig(Config):
    """The fit of body and poses to points of the body in the cameras' images."""

    SOURCE: ClassVar = "by hand"

    size: float = positive(0.15, "Standard deviation of the log of the body's size: children, too.")
    length: float = positive(
        0.1, "Standard deviation of the log of a bone's length beside the size."
    )
    angle: float = positive(
        1.0,
        "Standard deviation of an angle from rest; it matters only where the points do not "
        "determine the angle.",
        unit="rad",
    )
    noise: float = positive(
        0.02,
        "Standard deviation of the triangulated points, to which the poses are fitted first.",
        unit="m",
    )
    stray: float = positive(
        0.15, "Distance at which a triangulated point counts a quarter.", unit="m"
    )
    n_near_steps: int = nonnegative(
        40, "Number of steps of every frame's pose towards the triangulated points."
    )
    n_steps: int = natural(
        12, "Number of Gauss-Newton steps of all unknowns on the reprojection error."
    )
    first_reach: float = positive(
        8.0,
        "Distance at which a point in a picture counts a quarter in the first of them (Geman & "
        "McClure 1987).",
        unit="standard deviations",
    )
    last_reach: float = positive(
        2.5,
        "The same distance in the last of them; those between are spaced geometrically.",
        unit="standard deviations",
    )
    damping: float = nonnegative(
        1e-3, "Share of a pose's own normal matrix added to its diagonal (Levenberg 1944)."
    )
    suspect: float = positive(
        1.5,
        "Factor of the median missed share above which a frame's pose is fitted again, from "
        "the poses of neighbouring frames and turned by half a turn.",
    )
    n_independent: float = positive(
        2.0,
        "Effective number of independent frames, relative to the priors of the shared "
        "unknowns; limited, because the network's errors and the model's errors are similar in"
        " all frames.",
        "tuned: with 20 hips and shoulders lie 40 mm off",
    )


class KeypointStartConfig(Config):
    """The estimation of body and points from keypoints."""

    SOURCE: ClassVar = "by hand"

    n_frames: int = natural(
        40, "Number of frames to which body and points are fitted, evenly spread."
    )
    error: float = positive(
        8.0, "Initial error of a keypoint.", unit="px at a picture height of 480 px"
    )
    outlier: float = positive(
        20.0,
        "Mean reprojection error above which cameras are excluded from a point.",
        unit="px at a picture height of 480 px",
    )
    least_points: int = natural(6, "Least number of triangulated points of a frame that is used.")
    n_levels: int = natural(
        5,
        "Number of levels of confidence for which the error is estimated, each with as many "
        "keypoints.",
    )
    least_error: float = positive(
        1.0, "Least error of any keypoint.", unit="px at a picture height of 480 px"
    )
    fit: PointFitConfig = part(PointFitConfig)

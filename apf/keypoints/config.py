"""Settings of the detection, choice, comparison and triangulation of keypoints."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, natural, nonnegative, positive


class AssociationConfig(Config):
    """Settings of the assignment of persons in pictures to people in space."""

    SOURCE: ClassVar = "by hand, on bodies whose keypoints are known"

    largest_error: float = positive(
        0.06,
        "Median reprojection error, as a share of the person's size in the picture, up to which "
        "persons of different cameras are the same.",
    )
    least_points: int = natural(5, "Least number of points that persons in two cameras must share.")
    followed: float = positive(
        0.3,
        "Median distance, as a share of the person's size, up to which a person in a picture may "
        "be from where somebody was last seen.",
    )
    from_voxels: float = positive(
        0.6,
        "Distance of the mean of a person's keypoints from the middle of somebody's voxels up to "
        "which both may be of one person.",
        unit="m",
    )
    lasting: float = nonnegative(
        0.5,
        "Time for which somebody must be seen to count, and is followed while not seen.",
        unit="s",
    )

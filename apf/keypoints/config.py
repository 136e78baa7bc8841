"""Settings of the detection, choice, comparison and triangulation of keypoints."""

from __future__ import annotations

from typing import ClassVar

from pydantic import model_validator

from cl import InputError
from psfs.common.config import Config, fraction, natural, nonnegative, positive, setting


class CropConfig(Config):
    """The crop of pictures around the silhouette before the network sees them."""

    SOURCE: ClassVar = "by hand"

    margin: float = positive(
        0.5, "Margin on every side, as a share of the silhouette's larger side; more than `slack`."
    )
    slack: float = nonnegative(
        0.1,
        "Least distance of the silhouette from the crop's border, as a share of its larger "
        "side; below it, a new crop is made and the network detects the person again.",
    )
    largest: float = setting(
        4.0,
        "Size of a crop that is too large, as a multiple of the silhouette's; more than the margin "
        "alone makes.",
        above=1,
    )
    speckle: float = fraction(
        0.1, "Share of the largest part of the silhouette below which others are left out."
    )

    @model_validator(mode="after")
    def _fit(self) -> CropConfig:
        if not self.margin > self.slack:
            raise InputError(f"margin is {self.margin}; expected more than slack, {self.slack}")
        if not self.largest > 1 + 2 * self.margin:
            raise InputError(
                f"largest is {self.largest}; expected more than 1 + 2 margin, {1 + 2 * self.margin}"
            )
        return self


class StandingRegionConfig(Config):
    """The regions of pictures in which the network looks for each of several people."""

    SOURCE: ClassVar = "by hand, on Pose2Sim's `Demo_MultiPerson`"

    radius: float = positive(
        0.5, "Radius of the region about a person's axis, as a share of the height."
    )
    above: float = positive(1.25, "Height of the region, as a share of the person's.")
    trunk: float = fraction(
        0.67, "Height of the middle of shoulders and hips, as a share of the person's."
    )
    reach: float = positive(
        0.25,
        "Distance from that place, as a share of the person's height in the picture, beyond which "
        "keypoints are somebody else's.",
    )


class PersonConfig(Config):
    """Costs in the choice of the person to follow; confidence and size add a score from 0 to 1 in
    every frame."""

    SOURCE: ClassVar = "by hand"

    motion: float = nonnegative(
        2.0, "Cost of a step as long as the person's own size; longer steps cost no more."
    )
    agreement: float = nonnegative(
        3.0,
        "Cost of lying as far as the person's own size from where the other cameras see the "
        "person.",
    )
    rounds: int = nonnegative(
        3,
        "Number of rounds that compare cameras, each with the others' choice of the round before.",
    )
    largest_error: float = positive(
        0.3,
        "Reprojection error, as a share of the person's size in the picture, up to which cameras "
        "agree on a point.",
    )


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
    longest_gap: float = nonnegative(
        0.5, "Time for which somebody who is not seen is still followed.", unit="s"
    )
    speed: float = positive(4.0, "Greatest speed of a lost person who comes back.", unit="m/s")
    least_seconds: float = nonnegative(
        0.5, "Time for which somebody must be seen to count.", unit="s"
    )


class AgreementConfig(Config):
    """Limits beyond which keypoints count as wrong, see `apf.keypoints.agreement`."""

    SOURCE: ClassVar = (
        "set between what the sequences at hand show untouched and what they show spoilt"
    )

    away: float = positive(
        0.04,
        "Median distance, as a share of the picture's height, up to which a camera's keypoints may "
        "lie from where the others see them.",
        "untouched sequences: up to 0.025",
    )
    n_points: int = natural(100, "Number of examined keypoints, spread over frames and names.")
    confidence: float = fraction(0.3, "Least confidence of keypoints that count.")
    known: float = fraction(
        0.2, "Share of a camera's keypoints that the others must see somewhere, to be compared."
    )
    resolutions: tuple[float, ...] = setting(
        (0.25, 1 / 3, 0.5, 2 / 3, 1.5, 2.0, 3.0, 4.0),
        "Factors by which the pictures of the keypoints may be larger than the sequence's.",
    )


class LagConfig(Config):
    """Limits beyond which keypoints count as late, see `apf.keypoints.timing`."""

    SOURCE: ClassVar = (
        "set between what nine sequences show untouched and with one camera, or all, 5 frames late"
    )

    most: int = nonnegative(15, "Greatest lag that is tried, late or early.", unit="frames")
    least: int = natural(2, "Least lag that is reported.", unit="frames")
    confidence: float = fraction(0.3, "Least confidence of keypoints that count.")
    n_frames: int = natural(40, "Number of examined frames.", unit="frames")
    error: float = positive(
        0.02, "Reprojection error of a point, as a share of the picture's height."
    )
    camera_gain: float = setting(
        1.3,
        "Least factor between the distances of a camera's keypoints from where the others see "
        "them, without and with the lag.",
        "untouched sequences: up to 1.08; late ones: 1.5 and more",
        least=1,
    )
    camera_noise: float = positive(
        0.001, "Distance, as a share of the picture's height, that is noise."
    )
    footage_gain: float = setting(
        1.07,
        "Least factor between the distances of the keypoints' and the silhouettes' ends, without "
        "and with the lag.",
        "untouched sequences: up to 1.01; late ones: 1.10 and more",
        least=1,
    )
    footage_noise: float = positive(
        0.0005, "Distance, as a share of the picture's height, that is noise."
    )
    footage_cap: float = positive(
        0.05, "Greatest distance, as a share of the picture's height; more is no worse."
    )


class SideConfig(Config):
    """Limits beyond which left and right count as exchanged, see `apf.keypoints.sides`."""

    SOURCE: ClassVar = "nine sequences: nose and toes lie in front in 95 to 100 % of the frames"

    n_frames: int = natural(60, "Number of examined frames.", unit="frames")
    least_frames: int = natural(
        5, "Least number of frames in which nose or toes are known.", unit="frames"
    )
    error: float = positive(
        0.02, "Reprojection error of a point, as a share of the picture's height."
    )
    backward: float = setting(
        0.8, "Share of the frames in which nose and toes must lie behind.", least=0.5, most=1
    )

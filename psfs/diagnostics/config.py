"""Settings of the diagnostics, and definitions of their scores."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, natural, nonnegative, part, positive, setting

#: Parts of a silhouette smaller than this share of its largest part are speckle.
SPECKLE_SHARE = 0.02

DEFINITION = (
    "IoU of the reprojected surface voxels with the silhouette that they were made of: the pixels "
    "whose silhouette likelihood is above 0.5, within the projection of the reconstruction volume "
    "and beyond it where a part lies mostly within, "
    f"less speckle (5x5 median; parts under {SPECKLE_SHARE:.0%} of the largest one)"
)


class LimbConfig(Config):
    """Medial axes of limbs, which all cameras see, as measurements of these."""

    SOURCE: ClassVar = "by hand"

    per_camera: int = natural(800, "Points of each camera that are searched in the others.")
    noise: float = positive(0.3, "Least standard deviation of a point.", unit="px")


class AlignmentConfig(Config):
    """Settings of the correction of a rig that is slightly off, see
    `psfs.diagnostics.alignment`."""

    SOURCE: ClassVar = "by hand, for cameras that are turned by up to 0.7 degrees, and exact ones"

    on: bool = setting(True, "Whether to correct the rig.")
    turn: float = positive(
        0.008, "Standard deviation of a camera's rotation about an axis.", unit="rad"
    )
    shift: float = positive(
        0.01, "Standard deviation of the error of a camera's position along an axis.", unit="m"
    )
    focal: float = positive(0.005, "Standard deviation of the relative error of a focal length.")
    time: float = positive(
        0.5,
        "Standard deviation of a camera's offset in time; larger offsets are lags of whole frames.",
        unit="frames",
    )
    noise: float = positive(
        0.5,
        "Least standard deviation of the distance of a frontier point from its epipolar line.",
        unit="px",
    )
    gate: float = positive(
        4.0,
        "Greatest distance between frontier points that are matched in the last round; the first "
        "rounds match four times and twice as far.",
        unit="px",
    )
    bend: float = positive(
        2.0,
        "Greatest change of a tip's speed from frame to frame, and difference between two cameras.",
        "with 1 half as many tips count, and few fast ones",
        "px/frame",
    )
    information: float = setting(
        0.1,
        "Number of independent measurements per measurement of a tip that rests; below 1, because "
        "consecutive frames are similar.",
        above=0,
        most=1,
    )
    half_speed: float = positive(
        1.0,
        "Speed of a tip at which its measurement is worth half of an independent one more.",
        "one number for all tips leaves times to slow ones, which are many",
        "px/frame",
    )
    #: Medial axes of limbs, in the last matchings.
    limbs: LimbConfig = part(LimbConfig)
    least_rows: int = natural(4, "Least number of measurements per unknown.")


class OccluderConfig(Config):
    """Settings of the search for furniture that hides people, see `psfs.diagnostics.occluders`."""

    SOURCE: ClassVar = "by hand"

    on: bool = setting(True, "Whether to search for furniture; Song et al. have no such step.")
    voxels: int = setting(
        600_000, "Greatest number of voxels of the grid around the person.", least=1000
    )
    margin: int = nonnegative(
        3,
        "Distance from explained pixels within which foreground counts as explained, too.",
        unit="px",
    )
    least_pixels: int = natural(300, "Number of pixels below which a region is noise.", unit="px")


class FaultConfig(Config):
    """The tests of faults, see `psfs.diagnostics.fault`."""

    SOURCE: ClassVar = "by hand"

    false_alarms: float = setting(
        1e-3, "Probability of each test that footage without the fault is accused.", above=0, most=1
    )
    longest_side: int = setting(320, "Longest side of the small pictures.", unit="px", least=16)
    longest_offset: float = nonnegative(
        2.0, "Longest offset of a camera in time; at most a third of the frames.", unit="s"
    )


class InViewConfig(Config):
    """Least view of the person that each camera should have, see
    `psfs.diagnostics.person_in_view`."""

    SOURCE: ClassVar = "by hand"

    seen: float = fraction(0.7, "Share of the frames in which a camera should see somebody.")
    whole: float = fraction(0.8, "Share of these in which it should see the whole person.")
    height: float = positive(
        100.0,
        "Height of the person in a picture.",
        "forearms are then 4 px wide",
        unit="px",
    )

"""Settings of counting and following people."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, natural, nonnegative, part, positive, setting

#: Provenance of most settings of people.
_BY_HAND = "by hand, on `hard_duo_6cam` and single people in other rooms"


class FollowingConfig(Config):
    """Settings of trajectories: their regions in the next frame, exchanges, and contacts."""

    SOURCE: ClassVar = _BY_HAND

    axis_weight: float = nonnegative(
        0.5,
        "Weight of the distance from a person's predicted axis, added to the distance from the "
        "person's voxels in the frame before, where people touch.",
    )
    reach: float = nonnegative(
        0.4, "Least distance at which a trajectory looks for its region.", unit="m"
    )
    overlap: float = fraction(
        0.2,
        "Least share of a trajectory's moved voxels that must fall into a region for it to be "
        "theirs.",
    )
    change: float = nonnegative(
        0.7,
        "Volume that a region must gain or lose, as a share of one person's in it, for somebody to "
        "have come or gone.",
        "by hand, on silhouettes of capsules: 0.9 to 1.7 if somebody comes or goes, else up to 0.5",
    )
    newcomer: float = nonnegative(
        0.25,
        "Distance from all who were in a region beyond which its voxels may be a newcomer's.",
        "by hand, on silhouettes of capsules",
        unit="m",
    )
    newest: float = setting(
        0.5, "Weight of the last step in the running mean of a velocity.", above=0, most=1
    )
    ghost: float = fraction(
        0.25,
        "Least share of a region's silhouettes, in some camera, that the other regions of the "
        "frame do not explain; what is below it is a ghost, with which nobody begins.",
        "by hand: two people before four cameras, ghosts 0.02 to 0.18, people from 0.3 on",
    )
    heads: float = fraction(
        0.8,
        "Share of frames that must show as many heads, where people touch in all of them.",
        "by hand, on two who walk abreast, 0.57 m apart",
    )
    debris: int = natural(8, "Number of voxels below which a region is debris.")
    detached: float = nonnegative(
        0.4, "Distance from a trajectory's voxels up to which a region belongs to it.", unit="m"
    )
    swap_gain: float = nonnegative(
        0.1, "Least gain of similarity, summed over both, for two trajectories to be exchanged."
    )
    present: float = fraction(
        0.35, "Least share of the usual volume that a frame must show for the person to be in it."
    )
    contact: float = fraction(
        0.9,
        "Share of frames with contact above which a trajectory may be part of another person.",
    )
    apart: float = nonnegative(
        0.45,
        "Least distance, on the floor, of two people who touch in nearly all frames; what is "
        "nearer is a part.",
        unit="m",
    )


class IdentityConfig(Config):
    """Criteria by which two trajectories are one person who left and came back."""

    SOURCE: ClassVar = _BY_HAND

    speed: float = positive(4.0, "Greatest speed of a person.", unit="m/s")
    slack: float = nonnegative(
        0.3, "Distance that may be added to what the speed allows.", unit="m"
    )
    likeness: float = fraction(
        0.45, "Least similarity (Bhattacharyya coefficient) of the colours of two trajectories."
    )
    size: float = nonnegative(
        0.7, "Greatest difference of the logarithms of two trajectories' volumes."
    )
    size_weight: float = nonnegative(
        0.3, "Weight of that difference beside the unlikeness of colours."
    )
    distance_weight: float = nonnegative(
        0.2, "Weight of the distance, up to 1 m, beside the same.", unit="1/m"
    )
    looks: float = positive(4.0, "Frames per second whose colours are compared.", unit="frames/s")


class SeparationConfig(Config):
    """Assignment of voxels and pixels to one of several people."""

    SOURCE: ClassVar = _BY_HAND

    near: float = positive(
        0.2, "Distance from a person's coarse voxels up to which voxels are theirs.", unit="m"
    )
    beside: float = nonnegative(
        0.35,
        "Distance from a person's silhouette up to which foreground may be theirs: an arm that was "
        "carved away.",
        unit="m",
    )
    before: float = nonnegative(
        0.05, "Depth by which another one must be nearer to the camera to hide a person.", unit="m"
    )
    reach: float = nonnegative(
        0.35,
        "Distance from a person's coarse voxels up to which voxels of somebody they touch may "
        "be their arm.",
        unit="m",
    )
    core: float = nonnegative(
        0.28, "Distance from a person's axis within which voxels are no arm of others.", unit="m"
    )
    arms: float = fraction(
        0.4, "Height above which voxels may be others' arms, as share of a person's height."
    )
    apart: float = nonnegative(
        0.63,
        "Least distance of the axes of people whose arms are looked for on both sides: between "
        "those who walk abreast more nearly, each one's own arms hang.",
        unit="m",
    )
    lasting: float = nonnegative(
        0.2,
        "Time for which people touch on end before arms are looked for on both sides.",
        unit="s",
    )
    margin: float = nonnegative(
        0.2, "Room around the coarse voxels of all people, and of one.", unit="m"
    )


class AxisConfig(Config):
    """Settings of the search for the vertical axis of a person who stands."""

    SOURCE: ClassVar = "by hand, on Pose2Sim's `Demo_MultiPerson`"

    width: float = positive(
        0.15, "Standard deviation of the voxels' distance from the axis.", unit="m"
    )
    reach: float = positive(
        0.3, "Distance from the axis within which voxels determine its place.", unit="m"
    )


class PeopleConfig(Config):
    """Criteria for a person, and settings of following people from frame to frame."""

    SOURCE: ClassVar = _BY_HAND

    voxel: float = positive(0.08, "Edge of the voxels that people are counted in.", unit="m")
    longest_side: int = setting(
        480, "Longest side of the pictures that people are counted in.", unit="px", least=16
    )
    rate: float = positive(5.0, "Frames per second in which people are counted.", unit="frames/s")
    ceiling: float = positive(2.4, "Upper end of the volume in which people are counted.", unit="m")
    least_volume: float = positive(
        0.03, "Volume of silhouettes' hulls below which nothing is followed.", unit="m^3"
    )
    least_height: float = positive(
        0.9, "Least height of a region with which somebody begins to be followed.", unit="m"
    )
    tall: float = positive(
        1.2,
        "Height that a person reaches in a fifth of the frames; what never does is an object.",
        unit="m",
    )
    least_share: float = fraction(
        0.2,
        "Least volume of a second person, as share of the largest one's.",
        "by hand: a child of 1.15 m beside a tall man has 0.28",
    )
    lowest: float = setting(
        0.4, "Height above the floor at which a person's lowest part may be.", unit="m"
    )
    unexplained: float = fraction(
        0.15,
        "Least share of a second person's silhouettes, in some camera, that nobody else explains: "
        "a hull of several people has parts that nothing fills.",
    )
    least_seconds: float = nonnegative(
        0.5, "Time for which somebody must be seen to count.", unit="s"
    )
    following: FollowingConfig = part(FollowingConfig)
    identity: IdentityConfig = part(IdentityConfig)
    separation: SeparationConfig = part(SeparationConfig)
    standing: AxisConfig = part(AxisConfig)

"""Settings of counting and following people."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, part, setting
from psfs.voxels.config import DivisionConfig


class FollowingConfig(Config):
    """Settings of trajectories: their regions in the next frame, exchanges, and contacts."""

    SOURCE: ClassVar = "by hand, on `hard_duo_6cam` and single people in other rooms"

    axis_weight: float = setting(
        0.5,
        "Weight of the distance from a person's predicted axis, added to the distance from the "
        "person's voxels in the frame before, where people touch.",
        least=0,
    )
    newest: float = setting(
        0.5, "Weight of the last step in the running mean of a velocity.", above=0, most=1
    )
    debris: int = setting(8, "Number of voxels below which a region is debris.", least=1)
    detached: float = setting(
        0.4,
        "Distance from a trajectory's voxels up to which a region belongs to it.",
        unit="m",
        least=0,
    )
    swap_gain: float = setting(
        0.1,
        "Least gain of similarity, summed over both, for two trajectories to be exchanged.",
        least=0,
    )
    present: float = setting(
        0.35,
        "Least share of the usual volume that a frame must show for the person to be in it.",
        least=0,
        most=1,
    )
    contact: float = setting(
        0.9,
        "Share of frames with contact above which a trajectory is part of another person.",
        least=0,
        most=1,
    )


class PeopleConfig(Config):
    """Criteria for a person, and settings of following people from frame to frame."""

    SOURCE: ClassVar = "by hand, on `hard_duo_6cam` and single people in other rooms"

    voxel: float = setting(
        0.08, "Edge of the voxels that people are counted in.", unit="m", above=0
    )
    longest_side: int = setting(
        480, "Longest side of the pictures that people are counted in.", unit="px", least=16
    )
    rate: float = setting(
        5.0, "Frames per second in which people are counted.", unit="frames/s", above=0
    )
    ceiling: float = setting(
        2.4, "Upper end of the volume in which people are counted.", unit="m", above=0
    )
    least_volume: float = setting(
        0.03, "Volume of silhouettes' hulls below which nothing is followed.", unit="m^3", above=0
    )
    least_height: float = setting(
        0.9, "Least height of a second person; what is lower is an object.", unit="m", above=0
    )
    least_share: float = setting(
        0.35, "Least volume of a second person, as share of the largest one's.", least=0, most=1
    )
    lowest: float = setting(
        0.4, "Height above the floor at which a person's lowest part may be.", unit="m"
    )
    unexplained: float = setting(
        0.15,
        "Least share of a second person's silhouettes, in some camera, that nobody else explains: "
        "a hull of several people has parts that nothing fills.",
        least=0,
        most=1,
    )
    least_seconds: float = setting(
        0.5, "Time for which somebody must be seen to count.", unit="s", least=0
    )
    speed: float = setting(4.0, "Greatest speed of a person.", unit="m/s", above=0)
    likeness: float = setting(
        0.45,
        "Least similarity (Bhattacharyya coefficient) of the colours of two trajectories for them "
        "to be one person who left and came back.",
        least=0,
        most=1,
    )
    following: FollowingConfig = part(FollowingConfig, "Trajectories of people and objects.")
    division: DivisionConfig = part(DivisionConfig, "Voxels and foreground of tracked bodies.")

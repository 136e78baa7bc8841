"""Settings of counting and following people."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, setting


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

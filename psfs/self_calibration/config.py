"""Settings of the calibration by a person."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, setting


class PersonConfig(Config):
    """Settings of the calibration of cameras by a person who walks about."""

    SOURCE: ClassVar = "by hand on `synth_walk_4cam` and `synth_run_6cam`"

    stature: float = setting(
        1.7,
        "Height of the person, which gives the scale where none is stated.",
        "an adult's",
        "m",
        above=0.3,
        most=3.0,
    )
    longest_lag: float = setting(
        1.5,
        "Longest time by which one camera may be behind another.",
        unit="s",
        least=0,
        most=60,
    )
    longest_side: int = setting(640, "Longest side of the pictures used.", unit="px", least=64)
    most_frames: int = setting(
        300, "Number of frames of a camera that are used, the first ones.", least=20
    )
    table_rate: float = setting(
        15.0, "Frames per second at which lags are searched first.", unit="1/s", above=0
    )
    angles: int = setting(36, "Number of angles around the vertical that are tried.", least=8)
    candidates: int = setting(
        40, "Number of arrangements from the search that are adjusted.", least=1
    )
    finalists: int = setting(3, "Number of these that are adjusted to frontier points.", least=1)
    least_frames: int = setting(
        40, "Fewest frames of a camera that must show the whole person.", least=8
    )
    worst_residual: float = setting(
        1.2,
        "Greatest median distance of the outermost points of two cameras from epipolar lines.",
        unit="px",
        above=0,
    )
    least_path: float = setting(
        0.15,
        "Least standard deviation of the person's places along the walk's main direction, as a "
        "share of the stature.",
        least=0,
    )

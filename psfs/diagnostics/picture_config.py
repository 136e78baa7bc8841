"""Criteria by which pictures are faulty."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, setting


class PictureConfig(Config):
    """Criteria by which pictures are faulty, see `psfs.diagnostics.picture_faults`."""

    SOURCE: ClassVar = (
        "set between what the sequences at hand show untouched and what they show spoilt"
    )

    same_view: float = setting(
        0.85,
        "Least correlation of pictures with a background of the same view.",
        most=1,
    )
    other_view: float = setting(
        0.6,
        "Correlation of pictures with their background below which they show different views.",
        "untouched sequences: 0.93 and more",
        most=1,
    )
    knocked: float = setting(
        2.0,
        "Greatest shift between pictures and their background for a camera that was not moved.",
        "untouched sequences: below 1",
        "small pixels",
        least=0,
    )
    gain: float = setting(
        0.1, "Least increase of the edges' correlation if the pictures are shifted back.", least=0
    )
    flicker: float = setting(
        0.04,
        "Median change of the brightness from frame to frame above which the light flickers.",
        "untouched sequences: 0.015",
        least=0,
    )
    steady: float = setting(
        0.6,
        "Share of the frames that show foreground in one place if the background contains the "
        "person.",
        least=0,
        most=1,
    )
    still: float = setting(
        6.0,
        "Median deviation over time below which nothing moves at such a place.",
        unit="grey levels",
        least=0,
    )
    ghost_area: float = setting(
        0.15,
        "Least area of such a place as a share of the silhouette's area; twice as much if only "
        "one frame shows it.",
        least=0,
        most=1,
    )
    ghost_edges: float = setting(
        1.5,
        "Least ratio of the strength of the edges at its rim in the background to that in the "
        "frames.",
        "untouched sequences: 0.9; spoilt ones: 1.7 to 8",
        least=0,
    )
    ghost_seen: float = setting(1.2, "The same ratio if several frames show the place.", least=0)
    cut: float = setting(
        0.5,
        "Least share of the frames in which a silhouette touches the picture's border for a note.",
        least=0,
        most=1,
    )
    filled: float = setting(
        0.5, "Share of a picture that a person's silhouette fills at most.", least=0, most=1
    )
    blank: float = setting(
        2.0,
        "Standard deviation of a picture below which it shows nothing.",
        "untouched sequences: 20 and more",
        "grey levels",
        least=0,
    )
    frozen: float = setting(
        0.01, "Change of a silhouette's area over time below which its camera hangs.", least=0
    )
    hung: int = setting(
        10, "Number of frames of one silhouette after which a camera hangs.", unit="frames", least=3
    )
    moving: float = setting(
        0.05,
        "Change of the median camera's silhouette above which a camera that shows none hangs.",
        least=0,
    )
